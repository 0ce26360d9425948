//! One device under test with the host's client connected to it, for one trial.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use libtest_mimic::Failed;
use rcg::capture::device::{Device, Patience};
use rcg::capture::link::{Link, LinkError, SerialLink};

use crate::dut::{Dut, Jumper, Kind, LinkKind};
use crate::figures::{Figures, Limit};
use crate::image::Image;
use crate::log;
use crate::pico::{Pico, PicoLink, SharedPico};
use crate::places;

/// What a trial comes to.
pub type Outcome = Result<(), Failed>;

/// What a trial needs of the device under test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// The edges of the outputs are seen, to the tick.
    Edges,
    /// The inputs can be driven at will.
    Inputs,
    /// STROBE follows CAM.
    CamStrobe,
    /// The CPU can be made to fail.
    Memory,
    /// The host is at the USB port, and its cable can be pulled.
    Cable,
    /// A second Pico can be switched on.
    Emulator,
    /// The host's command was built.
    Command,
    /// It was built with drivers of cameras.
    Camera,
    /// An X server can be started, for a window of the command.
    Screen,
    /// The link carries 130 kB/s: step records at 9,523 Hz, schedules streamed at 20 kHz.
    FastLink,
}

impl Dut {
    /// Why this device cannot give what is needed; `None` if it can.
    #[must_use]
    pub fn lacks(&self, need: Need) -> Option<&'static str> {
        match (&self.kind, need) {
            (_, Need::Command) => {
                let built = places::command().is_file();
                (!built).then_some("needs the host's command, which `cargo build` makes")
            }
            (_, Need::Camera) => (!drives_cameras())
                .then_some("needs the host's command with the feature genicam, which needs libaravis"),
            (_, Need::Screen) => {
                (!has_screen()).then_some("needs the feature window, and Xvfb (Debian: xvfb)")
            }
            (Kind::Board(_), Need::Emulator) => Some("needs a Pico that can be switched on at will"),
            (Kind::Emulator(pico), Need::Cable | Need::FastLink) if pico.link == LinkKind::Uart => {
                Some("needs USB; this device is at the UART")
            }
            (Kind::Emulator(_), _) | (Kind::Board(_), Need::FastLink) => None,
            (Kind::Board(board), Need::CamStrobe) => {
                let wired = board.jumpers.contains(&Jumper::CamStrobe);
                (!wired).then_some("needs the jumper CAM-STROBE")
            }
            (Kind::Board(_), Need::Edges) => Some("needs a device whose output edges are seen"),
            (Kind::Board(_), Need::Inputs) => Some("needs a device whose inputs can be driven"),
            (Kind::Board(_), Need::Memory) => Some("needs a device whose CPU can be made to fail"),
            (Kind::Board(_), Need::Cable) => Some("needs a cable that a program can pull"),
        }
    }
}

/// Whether the host's command was built with drivers of cameras. It says so itself, by its exit code.
fn drives_cameras() -> bool {
    static ANSWER: OnceLock<bool> = OnceLock::new();
    *ANSWER.get_or_init(|| {
        let listed = std::process::Command::new(places::command())
            .args(["camera", "list"])
            .output();
        listed.is_ok_and(|output| output.status.success())
    })
}

/// Whether there is what takes the place of a monitor.
fn has_screen() -> bool {
    #[cfg(feature = "window")]
    {
        static ANSWER: OnceLock<bool> = OnceLock::new();
        *ANSWER.get_or_init(crate::screen::Xvfb::is_there)
    }
    #[cfg(not(feature = "window"))]
    false
}

/// The link to the device under test, which remembers what was sent.
pub struct Port {
    link: Box<dyn Link>,
    sent: Vec<Vec<u8>>,
}

impl Port {
    /// All that was sent, frame by frame.
    #[must_use]
    pub fn sent(&self) -> &[Vec<u8>] {
        &self.sent
    }
}

impl Link for Port {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.sent.push(bytes.to_vec());
        self.link.send(bytes)
    }
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        self.link.receive(buffer, timeout)
    }
    fn now(&self) -> Duration {
        self.link.now()
    }
    fn peer(&self) -> &str {
        self.link.peer()
    }
}

/// One device under test, connected.
pub struct Bench {
    /// The host's client.
    pub device: Device<Port>,
    pico: Option<SharedPico>,
    image: Option<PathBuf>,
    link: LinkKind,
    trial: String,
    figures: Arc<Figures>,
}

impl Bench {
    /// Runs `work` as `trial` on a bench of its own; if it fails, the firmware's log is part of the message.
    ///
    /// # Errors
    /// What `work` came to, or why there is no bench.
    pub fn run(dut: &Dut, trial: &str, figures: &Arc<Figures>, work: fn(&mut Self) -> Outcome) -> Outcome {
        let (pico, link, image) = match &dut.kind {
            Kind::Emulator(emulated) => {
                let pico = SharedPico::new(Pico::boot(emulated)?);
                (Some(pico), emulated.link, Some(emulated.image()))
            }
            Kind::Board(_) => (None, LinkKind::Usb, None),
        };
        let outcome = caught(|| {
            let (link_end, nonce): (Box<dyn Link>, u32) = match (&dut.kind, &pico) {
                (Kind::Board(board), _) => (Box::new(SerialLink::open(&board.port)?), fresh_nonce()),
                (_, Some(pico)) => (Box::new(PicoLink(pico.clone())), 1),
                (Kind::Emulator(_), None) => unreachable!("it was booted"),
            };
            let port = Port {
                link: link_end,
                sent: Vec::new(),
            };
            let mut bench = Self {
                device: Device::connect(port, nonce, Patience::default())?,
                pico: pico.clone(),
                image: image.clone(),
                link,
                trial: trial.to_owned(),
                figures: Arc::clone(figures),
            };
            work(&mut bench)
        });
        let (Err(failed), Some(pico), Some(image)) = (&outcome, &pico, image) else {
            return outcome;
        };
        let text = log::decode(Image::read(&image)?.elf(), pico.lock().rtt());
        let message = failed.message().unwrap_or_default();
        Err(format!("{message}\n\nlog of the firmware:\n{text}").into())
    }

    /// The emulated Pico.
    ///
    /// # Panics
    /// On a board: the trial should have said what it needs.
    #[must_use]
    pub fn pico(&self) -> &SharedPico {
        self.pico
            .as_ref()
            .expect("the trial needs something that only the emulator has")
    }

    /// The emulated Pico, if it is one.
    #[must_use]
    pub const fn emulated(&self) -> Option<&SharedPico> {
        self.pico.as_ref()
    }

    /// The ELF file that the emulated Pico runs.
    #[must_use]
    pub fn image(&self) -> Option<PathBuf> {
        self.image.clone()
    }

    /// Which link the host is at.
    #[must_use]
    pub const fn link(&self) -> LinkKind {
        self.link
    }

    /// Lets time pass without a word from the host.
    ///
    /// # Errors
    /// What the emulator says.
    pub fn silence(&mut self, time: Duration) -> Outcome {
        if let Some(pico) = &self.pico {
            let mut pico = pico.lock();
            let cycles = pico.cycles(time);
            pico.run(cycles)?;
        } else {
            std::thread::sleep(time);
        }
        Ok(())
    }

    /// Takes a figure down.
    ///
    /// # Errors
    /// If it is beyond its limit.
    pub fn figure(&self, name: &str, value: impl IntoFigure, unit: &'static str, limit: Limit) -> Outcome {
        self.figures
            .record(&self.trial, name, value.into_figure(), unit, limit)?;
        Ok(())
    }
}

/// A number that can be a figure.
pub trait IntoFigure {
    /// As a figure, exact up to 2⁵³.
    fn into_figure(self) -> f64;
}

impl IntoFigure for u32 {
    fn into_figure(self) -> f64 {
        f64::from(self)
    }
}

impl IntoFigure for u64 {
    fn into_figure(self) -> f64 {
        self as f64
    }
}

impl IntoFigure for usize {
    fn into_figure(self) -> f64 {
        self as f64
    }
}

impl IntoFigure for f64 {
    fn into_figure(self) -> f64 {
        self
    }
}

/// What `work` comes to; a panic is a failure like others.
fn caught(work: impl FnOnce() -> Outcome) -> Outcome {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let message = panic.downcast_ref::<String>().map(String::as_str);
        let message = message.or_else(|| panic.downcast_ref::<&str>().copied());
        Err(message.unwrap_or("the trial panicked").into())
    })
}

/// A nonce that was hardly used before: a board remembers the last one.
fn fresh_nonce() -> u32 {
    let since_epoch = std::time::SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default();
    since_epoch.as_micros() as u32
}
