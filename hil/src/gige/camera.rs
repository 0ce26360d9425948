//! The camera, as whoever shows it something holds it.

use std::net::{SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use super::control::Control;
use super::faults::Faults;
use super::gvcp;
use super::gvsp::Shot;
use super::registers::Effect;
use super::settings::{AcquisitionMode, Config, Settings, TriggerSource};
use super::stream::{Counts, Stream};
use super::test_image::TestImages;
use super::{GigeError, threads};

/// What became of a trigger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    /// The frame was sent.
    Streamed {
        /// Its block id.
        id: u64,
    },
    /// The frame has an id but was withheld on purpose ([`Faults::starved`]).
    Starved {
        /// Its block id.
        id: u64,
    },
    /// Nothing was exposed.
    Idle(Idle),
}

impl Sent {
    /// The frame's block id, if there is a frame.
    pub const fn id(self) -> Option<u64> {
        match self {
            Self::Streamed { id } | Self::Starved { id } => Some(id),
            Self::Idle(_) => None,
        }
    }

    /// Whether the frame was sent.
    pub const fn streamed(self) -> bool {
        matches!(self, Self::Streamed { .. })
    }
}

/// Why nothing is exposed at a trigger.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Idle {
    /// `AcquisitionStart` has not come, or the acquisition is over.
    #[error("no image is acquired")]
    NotAcquiring,
    /// Port or address of the stream channel is 0.
    #[error("the stream channel is closed")]
    NoStream,
    /// The camera goes its own pace.
    #[error("the frame trigger is off")]
    FreeRunning,
    /// The line is not the frame trigger's source.
    #[error("the frame trigger has another source")]
    OtherSource,
    /// Nothing gives that trigger here.
    #[error("the trigger of the acquisition's start is on")]
    AwaitsAcquisitionStart,
}

/// What threads and holder share.
pub(super) struct Shared {
    pub(super) settings: Settings,
    control: Mutex<Control>,
    stream: Mutex<Stream>,
    images: Mutex<TestImages>,
    /// Told when an acquisition starts, and at the end.
    pub(super) started: Condvar,
    pub(super) over: AtomicBool,
}

/// A panic elsewhere leaves nothing half done here that matters to a test.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    pub(super) fn control(&self) -> MutexGuard<'_, Control> {
        locked(&self.control)
    }

    fn stream(&self) -> MutexGuard<'_, Stream> {
        locked(&self.stream)
    }

    pub(super) fn ends(&self) -> bool {
        self.over.load(Ordering::Relaxed)
    }

    /// Hears a datagram, does what it says, and returns the answer.
    pub(super) fn hear(&self, from: SocketAddrV4, datagram: &[u8]) -> Option<Vec<u8>> {
        if self.stream().faults.silent {
            return None;
        }
        let mut control = self.control();
        let heard = control.hear(from, datagram, Instant::now());
        if heard.refused {
            self.stream().counts.refused += 1;
        }
        if heard.resend.is_none() && heard.effects.is_empty() {
            return heard.answer;
        }
        let config = control.config();
        let status = control.resend_status(&config);
        drop(control);
        if let Some(resend) = heard.resend.filter(|_| self.settings.resend) {
            self.stream().resend(resend, status, config.destination);
        }
        for effect in heard.effects {
            match effect {
                Effect::TestPacket => {
                    if let Some(destination) = config.destination {
                        self.stream().test_packet(config.packet_bytes, destination);
                    }
                }
                Effect::Opened => self.stream().begin(),
                Effect::Started => {
                    if self.settings.ids_per_acquisition {
                        self.stream().begin();
                    }
                    self.started.notify_all();
                }
                Effect::SoftwareTrigger => {
                    self.expose_test_image(TriggerSource::Software);
                }
                // The control channel has done them.
                Effect::Latch | Effect::Reset => {}
            }
        }
        heard.answer
    }

    /// Takes control from a client that is silent.
    pub(super) fn watch(&self) {
        if self.control().watch(Instant::now()) {
            self.stream().counts.control_lost += 1;
        }
    }

    /// Exposes a test image, at the software trigger or in free run; whether it could.
    pub(super) fn expose_test_image(&self, source: TriggerSource) -> bool {
        let (config, now_ns) = {
            let control = self.control();
            (control.config(), control.time_ns(Instant::now()))
        };
        let fires = if source == TriggerSource::Software {
            armed(&config, source).is_ok()
        } else {
            armed(&config, source) == Err(Idle::FreeRunning)
        };
        let Some(image) = fires.then(|| locked(&self.images).next(&config)).flatten() else {
            return false;
        };
        self.send(&config, image, true, now_ns, config.exposure_us)
            .id()
            .is_some()
    }

    fn send(
        &self,
        config: &Config,
        image: Arc<[u8]>,
        stamped: bool,
        timestamp_ns: u64,
        exposure_us: f64,
    ) -> Sent {
        let Some(destination) = config.destination else {
            return Sent::Idle(Idle::NoStream);
        };
        let mut control = self.control();
        if config.acquisition_mode == AcquisitionMode::SingleFrame {
            control.stop();
        }
        let mut stream = self.stream();
        let ticks = control.ticks(timestamp_ns);
        drop(control);
        let shot = Shot {
            config,
            destination,
            image,
            stamped,
            ticks,
            exposure_us,
        };
        match stream.send(shot) {
            (id, true) => Sent::Streamed { id },
            (id, false) => Sent::Starved { id },
        }
    }
}

/// Whether a trigger from `source` exposes a frame.
pub(super) fn armed(config: &Config, source: TriggerSource) -> Result<(), Idle> {
    if !config.acquiring {
        return Err(Idle::NotAcquiring);
    }
    if config.destination.is_none() {
        return Err(Idle::NoStream);
    }
    if config.acquisition_start.on {
        return Err(Idle::AwaitsAcquisitionStart);
    }
    if !config.frame_start.on {
        return Err(Idle::FreeRunning);
    }
    if config.frame_start.source != source {
        return Err(Idle::OtherSource);
    }
    Ok(())
}

/// A camera that is switched on; it is off when this is dropped.
pub struct GigeCamera {
    shared: Arc<Shared>,
    address: SocketAddrV4,
    threads: Vec<JoinHandle<()>>,
}

impl std::fmt::Debug for GigeCamera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GigeCamera")
            .field("address", &self.address)
            .finish_non_exhaustive()
    }
}

impl GigeCamera {
    /// Switches a camera on.
    ///
    /// # Errors
    /// [`GigeError::Settings`]; [`GigeError::Start`] where its address is not this machine's or another camera has it.
    pub fn start(settings: Settings) -> Result<Self, GigeError> {
        settings.check()?;
        let address = SocketAddrV4::new(settings.address, gvcp::PORT);
        let failed = |source| GigeError::Start { address, source };
        let control_socket = Arc::new(UdpSocket::bind(address).map_err(failed)?);
        let stream_socket = UdpSocket::bind((settings.address, 0)).map_err(failed)?;
        let stream_port = stream_socket.local_addr().map_err(failed)?.port();
        let shared = Arc::new(Shared {
            control: Mutex::new(Control::new(&settings, stream_port, Instant::now())),
            stream: Mutex::new(Stream::new(Arc::new(stream_socket), &settings)),
            images: Mutex::default(),
            started: Condvar::new(),
            over: AtomicBool::new(false),
            settings,
        });
        // From here on dropping the camera ends the threads that there are.
        let mut camera = Self {
            shared,
            address,
            threads: Vec::new(),
        };
        threads::start(&camera.shared, &control_socket, &mut camera.threads).map_err(failed)?;
        Ok(camera)
    }

    /// Where its control channel is.
    pub const fn address(&self) -> SocketAddrV4 {
        self.address
    }

    /// What clients have set.
    pub fn config(&self) -> Config {
        self.shared.control().config()
    }

    /// Why a trigger at the line would expose nothing now; `None` if it would.
    pub fn idle(&self) -> Option<Idle> {
        armed(&self.config(), TriggerSource::Line1).err()
    }

    /// A trigger came at the line: a frame is exposed and sent, if the camera is set to it. `image` has the region
    /// and pixel format of [`Self::config`], rows from above ([`PixelFormat::pack`](super::PixelFormat::pack)). Its
    /// time-stamp is `timestamp_ns` of the camera's clock, the exposure took `exposure_us`, which a chunk says.
    ///
    /// # Errors
    /// [`GigeError::Image`] if the image has another size; then there is no frame, and no id is used.
    pub fn expose(&self, image: &[u8], timestamp_ns: u64, exposure_us: f64) -> Result<Sent, GigeError> {
        let config = {
            let mut control = self.shared.control();
            control.set_time(Instant::now(), timestamp_ns);
            control.config()
        };
        if let Err(idle) = armed(&config, TriggerSource::Line1) {
            return Ok(Sent::Idle(idle));
        }
        if image.len() != config.image_bytes() {
            return Err(GigeError::Image {
                expected: config.image_bytes(),
                width: config.region.width,
                height: config.region.height,
                format: config.format.name(),
                found: image.len(),
            });
        }
        Ok(self
            .shared
            .send(&config, image.into(), false, timestamp_ns, exposure_us))
    }

    /// A trigger came at the line while the sensor was busy: nothing is exposed, and ids stay consecutive.
    pub fn swallow(&self) {
        self.shared.stream().counts.swallowed += 1;
    }

    /// What goes wrong on purpose.
    pub fn faults(&self) -> Faults {
        self.shared.stream().faults.clone()
    }

    /// Says what goes wrong on purpose from now on.
    pub fn set_faults(&self, faults: Faults) {
        self.shared.control().clock_ppm = faults.clock_ppm;
        self.shared.stream().faults = faults;
    }

    /// What has happened so far.
    pub fn counts(&self) -> Counts {
        self.shared.stream().counts
    }

    /// What the camera answers to a datagram that comes from `from`, as if it had come over the network; what it
    /// orders is done.
    pub fn hear(&self, from: SocketAddrV4, datagram: &[u8]) -> Option<Vec<u8>> {
        self.shared.hear(from, datagram)
    }
}

impl Drop for GigeCamera {
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::Relaxed);
        self.shared.started.notify_all();
        // Wakes the control channel's thread, which would look only later.
        if let Ok(socket) = UdpSocket::bind((*self.address.ip(), 0)) {
            let _ = socket.send_to(&[], self.address);
        }
        for thread in self.threads.drain(..) {
            // A thread that panicked has said so.
            let _ = thread.join();
        }
    }
}
