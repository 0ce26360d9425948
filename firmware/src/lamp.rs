//! What the LED shows.
//!
//! | LED | state |
//! |---|---|
//! | one short flash every two seconds | idle, loaded, or the last run ended as it should |
//! | two short flashes every second | armed: the next command fires |
//! | on | running |
//! | five flashes a second | the last run ended with a fault |
//! | dark, or always the same | the firmware does not run |
//!
//! # Design
//! The level is a function of state and time, so that nothing has to be kept.

use embassy_rp::gpio::Level;
use rcg_protocol::State;

/// Length of a short flash.
const FLASH_MS: u64 = 60;
/// From one heartbeat to the next.
const HEARTBEAT_MS: u64 = 2000;
/// From one double flash to the next.
const ARMED_MS: u64 = 1000;
/// From the first flash of the two to the second.
const SECOND_FLASH_MS: u64 = 200;
/// From one flash of a fault to the next.
const FAULT_MS: u64 = 200;

/// Level of the LED in `state`, `now_ms` after boot.
pub(crate) fn level(state: State, now_ms: u64) -> Level {
    let lit = match state {
        State::Running => true,
        State::Armed => {
            let phase = now_ms % ARMED_MS;
            phase < FLASH_MS || (SECOND_FLASH_MS..SECOND_FLASH_MS + FLASH_MS).contains(&phase)
        }
        State::Fault => now_ms % FAULT_MS < FAULT_MS / 2,
        State::Idle | State::Loaded | State::Done | State::Stopped | State::Aborted => {
            now_ms % HEARTBEAT_MS < FLASH_MS
        }
    };
    Level::from(lit)
}
