//! The control channel: who may do what, and what comes of it.
//!
//! # Design
//! Datagrams and the time come in, answers and effects go out; sockets are elsewhere.
//!
//! Who writes control (2) or exclusive access (1) to the privilege register is the primary application until it
//! writes 0 there or is silent for longer than the heartbeat time-out; then stream and acquisition end. Others can
//! read, unless the access is exclusive, and are denied to write (status 8006).

use std::net::SocketAddrV4;
use std::time::{Duration, Instant};

use super::faults::drifted;
use super::gvcp::{self, Command, Refused, Resend, Status};
use super::map;
use super::registers::{Effect, Registers};
use super::settings::{Config, Settings};

/// What is to be done about a datagram.
#[derive(Debug, Default)]
pub(super) struct Heard {
    pub(super) answer: Option<Vec<u8>>,
    pub(super) effects: Vec<Effect>,
    pub(super) resend: Option<Resend>,
    pub(super) refused: bool,
}

struct Controller {
    who: SocketAddrV4,
    privilege: u32,
    heard: Instant,
}

/// The camera's clock: a moment and its time.
struct Clock(Instant, u64);

/// The control channel.
pub(super) struct Control {
    registers: Registers,
    controller: Option<Controller>,
    clock: Clock,
    tick_hz: u64,
    loops: bool,
    /// Parts in a million by which the clock is too fast.
    pub(super) clock_ppm: f64,
}

impl Control {
    pub(super) fn new(settings: &Settings, stream_port: u16, now: Instant) -> Self {
        Self {
            registers: Registers::new(settings, stream_port),
            controller: None,
            clock: Clock(now, 0),
            tick_hz: settings.tick_hz,
            loops: settings.address.is_loopback(),
            clock_ppm: 0.0,
        }
    }

    pub(super) fn config(&self) -> Config {
        self.registers
            .config(self.controller.as_ref().map(|held| held.who))
    }

    /// How packets that are sent again are marked.
    pub(super) fn resend_status(&self, config: &Config) -> Status {
        let marked = self.registers.get(map::GVCP_CONFIGURATION) & map::EXTENDED_STATUS != 0;
        // Flags of 64-bit ids always say it.
        if marked || config.extended_ids {
            Status::PacketResend
        } else {
            Status::Success
        }
    }

    /// The camera's time in ns.
    pub(super) fn time_ns(&self, now: Instant) -> u64 {
        let Clock(then, time) = self.clock;
        time.saturating_add(now.saturating_duration_since(then).as_nanos() as u64)
    }

    /// It is `time_ns` now.
    pub(super) fn set_time(&mut self, now: Instant, time_ns: u64) {
        self.clock = Clock(now, time_ns);
    }

    /// A time in ticks of the clock, however wrong that is.
    pub(super) fn ticks(&self, time_ns: u64) -> u64 {
        let ticks = u128::from(drifted(time_ns, self.clock_ppm)) * u128::from(self.tick_hz) / 1_000_000_000;
        u64::try_from(ticks).unwrap_or(u64::MAX)
    }

    /// The acquisition has got what it was to get.
    pub(super) fn stop(&mut self) {
        self.registers.set(map::ACQUISITION, 0);
    }

    /// Takes control from a client that was silent for too long; whether there was one.
    pub(super) fn watch(&mut self, now: Instant) -> bool {
        let disabled = self.registers.get(map::GVCP_CONFIGURATION) & map::HEARTBEAT_DISABLE != 0;
        let timeout = Duration::from_millis(self.registers.get(map::HEARTBEAT).into());
        let late = |held: &Controller| now.saturating_duration_since(held.heard) > timeout;
        let lost = !disabled && self.controller.as_ref().is_some_and(late);
        if lost {
            self.release();
        }
        lost
    }

    fn release(&mut self) {
        self.controller = None;
        self.registers.end_stream();
        self.registers.state_controller(None);
    }

    /// What is to be done about `datagram`, which came `now`.
    pub(super) fn hear(&mut self, from: SocketAddrV4, datagram: &[u8], now: Instant) -> Heard {
        let request = match gvcp::parse(datagram) {
            Ok(request) => request,
            Err(Refused(answer)) => {
                return Heard {
                    answer,
                    refused: true,
                    ..Heard::default()
                };
            }
        };
        if let Some(held) = self.controller.as_mut().filter(|held| held.who == from) {
            held.heard = now;
        }
        let mut heard = Heard::default();
        let (status, bytes) = match &request.command {
            // A client that finds a loopback address through another interface would expect frames there, and get none.
            Command::Discovery if self.loops && !from.ip().is_loopback() => return heard,
            Command::Discovery => (Status::Success, self.registers.discovery().to_vec()),
            Command::ReadRegisters(addresses) => self.read(from, addresses),
            Command::ReadMemory { address, count } => match self.read_memory(from, *address, *count) {
                Ok(bytes) => (Status::Success, bytes),
                Err(status) => (status, Vec::new()),
            },
            Command::WriteRegisters(pairs) => {
                let mut done = 0;
                let mut status = Status::Success;
                for &(address, value) in pairs {
                    match self.write(from, address, value, now) {
                        Ok(effect) => heard.effects.extend(effect),
                        Err(failed) => {
                            status = failed;
                            break;
                        }
                    }
                    done += 1;
                }
                (status, written(done))
            }
            Command::WriteMemory { address, bytes } => {
                let may = self.check_control(from).map_err(|status| (status, 0));
                let wrote =
                    may.and_then(|()| self.registers.write_memory(*address, bytes, &mut heard.effects));
                match wrote {
                    Ok(()) => (Status::Success, written(bytes.len())),
                    Err((status, done)) => (status, written(done)),
                }
            }
            Command::Resend(resend) => {
                // Clients ask from another port than that of their control channel.
                let known = self.controller.as_ref().map(|held| *held.who.ip());
                let stream = self.config().destination.map(|to| *to.ip());
                if known == Some(*from.ip()) || stream == Some(*from.ip()) {
                    heard.resend = Some(*resend);
                }
                return heard;
            }
        };
        heard.refused = status != Status::Success;
        self.do_own(&mut heard.effects, now);
        if request.acknowledge {
            let code = request.command.acknowledge_code();
            heard.answer = Some(gvcp::acknowledge(status, code, request.id, &bytes));
        }
        heard
    }

    fn check_read(&self, from: SocketAddrV4) -> Result<(), Status> {
        let exclusive = |held: &Controller| held.who != from && held.privilege & map::EXCLUSIVE != 0;
        if self.controller.as_ref().is_some_and(exclusive) {
            return Err(Status::AccessDenied);
        }
        Ok(())
    }

    fn check_control(&self, from: SocketAddrV4) -> Result<(), Status> {
        if self.controller.as_ref().is_some_and(|held| held.who == from) {
            return Ok(());
        }
        Err(Status::AccessDenied)
    }

    fn read(&self, from: SocketAddrV4, addresses: &[u32]) -> (Status, Vec<u8>) {
        let mut bytes = Vec::with_capacity(4 * addresses.len());
        for &address in addresses {
            // Whether it is free, everybody may see.
            let allowed = if address == map::PRIVILEGE {
                Ok(())
            } else {
                self.check_read(from)
            };
            match allowed.and_then(|()| self.registers.read(address)) {
                Ok(value) => bytes.extend(value.to_be_bytes()),
                Err(status) => return (status, bytes),
            }
        }
        (Status::Success, bytes)
    }

    fn read_memory(&self, from: SocketAddrV4, address: u32, count: u16) -> Result<Vec<u8>, Status> {
        self.check_read(from)?;
        let memory = self.registers.read_memory(address, count)?;
        let mut bytes = address.to_be_bytes().to_vec();
        bytes.extend(memory);
        Ok(bytes)
    }

    fn write(
        &mut self,
        from: SocketAddrV4,
        address: u32,
        value: u32,
        now: Instant,
    ) -> Result<Option<Effect>, Status> {
        if address == map::PRIVILEGE {
            return self.write_privilege(from, value, now).map(|()| None);
        }
        self.check_control(from)?;
        self.registers.write(address, value)
    }

    fn write_privilege(&mut self, from: SocketAddrV4, value: u32, now: Instant) -> Result<(), Status> {
        if value & !(map::EXCLUSIVE | map::CONTROL) != 0 {
            return Err(Status::InvalidParameter);
        }
        if self.controller.as_ref().is_some_and(|held| held.who != from) {
            return Err(Status::AccessDenied);
        }
        if value == 0 {
            self.release();
            return Ok(());
        }
        self.controller = Some(Controller {
            who: from,
            privilege: value,
            heard: now,
        });
        self.registers.state_controller(Some((from, value)));
        Ok(())
    }

    /// Does what concerns the clock alone.
    fn do_own(&mut self, effects: &mut Vec<Effect>, now: Instant) {
        effects.retain(|effect| {
            match effect {
                Effect::Latch => {
                    let ticks = self.ticks(self.time_ns(now));
                    self.registers.set(map::TIMESTAMP, (ticks >> 32) as u32);
                    self.registers.set(map::TIMESTAMP + 4, ticks as u32);
                }
                Effect::Reset => self.set_time(now, 0),
                _ => return true,
            }
            false
        });
    }
}

/// The bytes of an acknowledge to a write: how much of it was done.
fn written(done: usize) -> Vec<u8> {
    (done as u32).to_be_bytes().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The status of the acknowledge to a write.
    fn write(control: &mut Control, from: SocketAddrV4, (at, value): (u32, u32), now: Instant) -> u16 {
        let mut datagram = vec![0x42, 1, 0, 0x82, 0, 8, 0, 1];
        datagram.extend(at.to_be_bytes());
        datagram.extend(value.to_be_bytes());
        let answer = control
            .hear(from, &datagram, now)
            .answer
            .expect("it is asked for");
        gvcp::u16_at(&answer, 0)
    }

    #[test]
    fn control_lasts_as_long_as_a_client_is_heard_within_the_heartbeat() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut control = Control::new(&Settings::default(), 1, start);
        let client = |port| SocketAddrV4::new([127, 0, 0, 1].into(), port);
        assert_eq!(write(&mut control, client(1), (map::PRIVILEGE, 2), at(0)), 0);
        assert_eq!(write(&mut control, client(1), (map::HEARTBEAT, 500), at(0)), 0);
        for ms in (400..4000).step_by(400) {
            assert!(!control.watch(at(ms)), "{ms}");
            assert_eq!(write(&mut control, client(1), (map::PRIVILEGE, 2), at(ms)), 0);
            // What others say does not count.
            assert_eq!(
                write(&mut control, client(2), (map::WIDTH, 96), at(ms + 399)),
                0x8006
            );
        }
        assert!(!control.watch(at(4100)) && control.watch(at(4101)) && !control.watch(at(4102)));
        assert_eq!(write(&mut control, client(1), (map::WIDTH, 96), at(4200)), 0x8006);
        // Who debugs a client may disable it.
        let disabled = (map::GVCP_CONFIGURATION, map::HEARTBEAT_DISABLE);
        assert_eq!(write(&mut control, client(2), (map::PRIVILEGE, 2), at(5000)), 0);
        assert_eq!(write(&mut control, client(2), disabled, at(5000)), 0);
        assert!(!control.watch(at(1_000_000)));
    }
}
