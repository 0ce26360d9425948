//! The board: the one place that names pins, peripherals and the constants that depend on them.
//!
//! | GPIO | line | direction |
//! |---|---|---|
//! | 0 | UART0 TX | out |
//! | 1 | UART0 RX | in |
//! | 2 | PROJ | out |
//! | 3 | CAM | out |
//! | 4 | SYNC | in |
//! | 5 | STROBE | in |
//! | 6 | AUX-A | out |
//! | 7 | AUX-B | out |
//! | 8 | PHOTO | in |
//! | 9 | START | in |
//! | 25 | LED | out |
//!
//! # Design
//! After reset the pads are inputs with pull-downs, so all outputs are low before any code runs. The first
//! thing after the clocks is to drive them to rest, the pulse engine takes them over at that level, and
//! [`force_outputs_to_rest`] takes them back from it whatever state it is in.

pub(crate) mod begun;
pub(crate) mod capture;
pub(crate) mod chain;
pub(crate) mod engine;
pub(crate) mod identity;
mod kept;
mod last_resort;
pub(crate) mod programs;
mod vectors;

pub(crate) use kept::schedule;
pub(crate) use last_resort::{boot_loader, reset};

use embassy_rp::clocks::{ClockConfig, RoscRng, clk_sys_freq};
use embassy_rp::config::Config;
use embassy_rp::gpio::{Level, Output};
use embassy_rp::interrupt::{self, InterruptExt, Priority};
use embassy_rp::peripherals::{
    DMA_CH0, DMA_CH1, DMA_CH2, DMA_CH3, DMA_CH4, DMA_CH5, DMA_CH6, DMA_CH7, PIN_0, PIN_1, PIN_2, PIN_3,
    PIN_4, PIN_5, PIN_6, PIN_7, PIN_8, PIN_9, PIO0, UART0, USB,
};
use embassy_rp::watchdog::Watchdog;
use embassy_rp::{Peri, bind_interrupts, pac};
use embassy_time::{Duration, Instant};
use rcg_firmware::kept::Kept;
use rcg_protocol::{Reset, Ticks, Unit};

/// PROJ; CAM follows it, as the PIO writes both with one instruction.
pub(crate) const PROJ: usize = 2;
/// CAM.
pub(crate) const CAM: usize = PROJ + 1;

/// AUX-A: the PIO writes it with the same instruction too, and the two pins between, which are inputs.
pub(crate) const AUX_A: usize = PROJ + 4;
/// AUX-B.
pub(crate) const AUX_B: usize = AUX_A + 1;

/// State machine of PIO0 that makes the pulses.
pub(crate) const SM_PULSE: usize = 0;
/// State machine of PIO0 that watches STROBE.
pub(crate) const SM_STROBE: usize = 1;
/// State machine of PIO0 that watches SYNC.
pub(crate) const SM_SYNC: usize = 2;

/// State machine of PIO0 that watches PHOTO.
pub(crate) const SM_PHOTO: usize = 3;

/// Inputs that have a state machine each, and the first of these.
pub(crate) const INPUTS: usize = 3;
pub(crate) const FIRST_INPUT: usize = SM_STROBE;

/// The DMA channels that take turns in feeding the pulse engine.
pub(crate) const DMA_PULSE: [usize; 2] = [0, 1];
/// The DMA channel that brings the outputs to rest when nothing else follows.
pub(crate) const DMA_REST: usize = 2;
/// The DMA channel that stores the edges of STROBE.
pub(crate) const DMA_STROBE: usize = 3;
/// The DMA channel that stores the edges of SYNC.
pub(crate) const DMA_SYNC: usize = 4;

/// The DMA channel that takes the pulse engine's word for each step which began on a SYNC edge.
pub(crate) const DMA_BEGUN: usize = 5;
/// The DMA channel that stores when that was.
pub(crate) const DMA_BEGUN_AT: usize = 6;

/// The DMA channel that stores the edges of PHOTO.
pub(crate) const DMA_PHOTO: usize = 7;

/// Crystal of a Pico.
#[cfg(not(feature = "clock-200mhz"))]
const CRYSTAL_HZ: u32 = 12_000_000;

/// Bits per second of UART0: the highest rate that every USB bridge makes. From 125 MHz the PL011 divides by
/// 8 + 31/64, which is off by 0.2 %.
pub(crate) const UART_BAUD: u32 = 921_600;

/// From one poll of the session to the next: a tenth of what a person notices, a hundredth of the CPU.
pub(crate) const POLL: Duration = Duration::from_millis(1);

/// If the main loop does not come round for this long the chip is reset: hundreds of its rounds, and less
/// than an exposure that was forgotten could harm.
pub(crate) const WATCHDOG: Duration = Duration::from_millis(500);

bind_interrupts!(
    /// Who serves which interrupt; that of the DMA is the controller's.
    pub(crate) struct Irqs {
        UART0_IRQ => embassy_rp::uart::BufferedInterruptHandler<UART0>;
        USBCTRL_IRQ => embassy_rp::usb::InterruptHandler<USB>;
        PIO0_IRQ_0 => embassy_rp::pio::InterruptHandler<PIO0>;
    }
);

/// The controller's clock, in ticks since boot.
///
/// It has the rate of the pulse engine's ticks, as timer and PIO run from the same crystal, but it steps by a
/// microsecond. Times within a run come from the PIO and are exact.
#[derive(Clone, Copy)]
pub(crate) struct Clock {
    hz: u32,
    per_us: u32,
}

impl Clock {
    /// A clock of `hz`, a multiple of 1 MHz.
    const fn new(hz: u32) -> Self {
        Self {
            hz,
            per_us: hz / 1_000_000,
        }
    }

    /// Ticks per second.
    pub(crate) const fn hz(self) -> u32 {
        self.hz
    }

    /// `us` microseconds.
    pub(crate) fn micros(self, us: u32) -> Ticks {
        Ticks(u64::from(us * self.per_us))
    }

    /// Lets `us` microseconds pass, and up to one more.
    pub(crate) fn spin(self, us: u32) {
        let until = self.now() + self.micros(us + 1);
        while self.now() < until {}
    }

    /// The time at which the lower 32 bits of the timer said `micros`, not longer than an hour ago.
    pub(crate) fn at_micros(self, micros: u32) -> Ticks {
        let now = Instant::now().as_micros();
        let ago = (now as u32).wrapping_sub(micros);
        Ticks((now - u64::from(ago)) * u64::from(self.per_us))
    }

    /// Now.
    pub(crate) fn now(self) -> Ticks {
        Ticks(Instant::now().as_micros() * u64::from(self.per_us))
    }
}

/// UART0 and its pins.
pub(crate) struct UartParts {
    pub(crate) uart: Peri<'static, UART0>,
    pub(crate) tx: Peri<'static, PIN_0>,
    pub(crate) rx: Peri<'static, PIN_1>,
}

/// What the pulse engine is made of. The DMA channels are held so that nobody else can have them.
pub(crate) struct PulseParts {
    pub(crate) pio: Peri<'static, PIO0>,
    pub(crate) proj: Peri<'static, PIN_2>,
    pub(crate) cam: Peri<'static, PIN_3>,
    pub(crate) sync: Peri<'static, PIN_4>,
    pub(crate) strobe: Peri<'static, PIN_5>,
    pub(crate) aux_a: Peri<'static, PIN_6>,
    pub(crate) aux_b: Peri<'static, PIN_7>,
    pub(crate) photo: Peri<'static, PIN_8>,
    pub(crate) start: Peri<'static, PIN_9>,
    pub(crate) dma: DmaParts,
}

/// Channels 0 to 7, see [`DMA_PULSE`] and the constants after it.
pub(crate) type DmaParts = (
    Peri<'static, DMA_CH0>,
    Peri<'static, DMA_CH1>,
    Peri<'static, DMA_CH2>,
    Peri<'static, DMA_CH3>,
    Peri<'static, DMA_CH4>,
    Peri<'static, DMA_CH5>,
    Peri<'static, DMA_CH6>,
    Peri<'static, DMA_CH7>,
);

/// The board, taken apart.
pub(crate) struct Board {
    pub(crate) clock: Clock,
    pub(crate) uart: UartParts,
    pub(crate) usb: Peri<'static, USB>,
    pub(crate) pulse: PulseParts,
    pub(crate) led: Output<'static>,
    pub(crate) watchdog: Watchdog,
    /// Whether the power came, or the reset pin was released: nothing else has reset the chip.
    pub(crate) powered_up: bool,
    /// Differs from boot to boot.
    pub(crate) seed: u32,
    /// Which box it is.
    pub(crate) unit: Unit,
    /// The polarity that is kept over resets.
    pub(crate) kept: Kept,
}

impl Board {
    /// Starts the clocks, drives the outputs to rest and starts the watchdog. To be called once.
    #[unsafe(link_section = ".boot_text")]
    #[inline(never)]
    pub(crate) fn take() -> Self {
        let p = embassy_rp::init(Config::new(clocks()));
        let kept = kept::read();
        kept::rest_like(kept);
        force_outputs_to_rest();
        vectors::move_to_ram();
        // What feeds the pulse engine goes before what computes.
        pac::BUSCTRL.bus_priority().write(|w| {
            w.set_dma_r(true);
            w.set_dma_w(true);
        });

        let clock = Clock::new(clk_sys_freq());
        let mut watchdog = Watchdog::new(p.WATCHDOG);
        let powered_up = watchdog.reset_reason().is_none();
        let reset = identity::reset_reason(&mut watchdog);
        watchdog.start(WATCHDOG);
        let unit = identity::unit(&mut watchdog, p.FLASH, reset);
        let (major, minor, patch) = rcg_firmware::VERSION;
        defmt::info!("RCG {}.{}.{} at {} Hz", major, minor, patch, clock.hz());
        if unit.reset != Reset::PowerOn {
            defmt::warn!("the box was reset: {}", unit.reset);
        }

        // Refilling may not hold up the UART, whose FIFO is full after 350 µs.
        interrupt::UART0_IRQ.set_priority(Priority::P0);
        interrupt::DMA_IRQ_0.set_priority(Priority::P1);

        Self {
            clock,
            uart: UartParts {
                uart: p.UART0,
                tx: p.PIN_0,
                rx: p.PIN_1,
            },
            usb: p.USB,
            pulse: PulseParts {
                pio: p.PIO0,
                proj: p.PIN_2,
                cam: p.PIN_3,
                sync: p.PIN_4,
                strobe: p.PIN_5,
                aux_a: p.PIN_6,
                aux_b: p.PIN_7,
                photo: p.PIN_8,
                start: p.PIN_9,
                dma: (
                    p.DMA_CH0, p.DMA_CH1, p.DMA_CH2, p.DMA_CH3, p.DMA_CH4, p.DMA_CH5, p.DMA_CH6, p.DMA_CH7,
                ),
            },
            led: Output::new(p.PIN_25, Level::Low),
            watchdog,
            powered_up,
            seed: RoscRng.next_u32() ^ Instant::now().as_ticks() as u32,
            unit,
            kept,
        }
    }
}

/// The chip's usual clock: 125 MHz on the RP2040, 150 MHz on the RP2350. The host is told which.
#[cfg(not(feature = "clock-200mhz"))]
fn clocks() -> ClockConfig {
    ClockConfig::crystal(CRYSTAL_HZ)
}

#[cfg(all(rp2350, feature = "clock-200mhz"))]
compile_error!("`clock-200mhz` is for the RP2040: no data sheet allows the RP2350 more than 150 MHz");

/// The highest clock that the RP2040's data sheet allows, with the core voltage that it asks for.
#[cfg(feature = "clock-200mhz")]
fn clocks() -> ClockConfig {
    ClockConfig::system_freq(200_000_000).expect("the PLL makes 200 MHz from 12 MHz")
}

/// Drives all outputs to where they rest, low unless a [kept](kept) polarity says otherwise, and keeps them there, whatever the
/// PIO does.
pub(crate) fn force_outputs_to_rest() {
    /// Selects the CPU's own output register (data sheet, "GPIO functions", F5).
    const SIO: u8 = 5;
    let mask = 1 << PROJ | 1 << CAM | 1 << AUX_A | 1 << AUX_B;
    let high = kept::resting_high();
    pac::SIO.gpio_out(0).value_clr().write_value(mask & !high);
    pac::SIO.gpio_out(0).value_set().write_value(high);
    pac::SIO.gpio_oe(0).value_set().write_value(mask);
    for pin in [PROJ, CAM, AUX_A, AUX_B] {
        pac::PADS_BANK0.gpio(pin).modify(|pad| {
            pad.set_od(false);
            #[cfg(rp2350)]
            pad.set_iso(false);
        });
        pac::IO_BANK0.gpio(pin).ctrl().write(|w| w.set_funcsel(SIO));
    }
}
