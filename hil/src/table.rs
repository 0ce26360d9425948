//! An optical table without optics: everything of a measurement is real but the light.
//!
//! # Design
//! The host's command finds the parts where real ones would be: an emulated Pico with the real firmware at a serial port, a
//! GigE Vision camera on the network, and a folder for the patterns of a projector that another program drives. What they
//! would see and show comes from the virtual rig: PROJ edges of the firmware advance through the pictures in the folder, CAM edges
//! expose, STROBE answers, and the images go out as frames of the camera. In place of the folder an emulated [`Dlpc900`] can stand there
//! ([`Table::lay_with`]): what was uploaded to it is what PROJ advances through.
//!
//! The table knows nothing of plans: what is measured, in which order and how often, is the command's affair alone. What stands in
//! the holder is what a file beside the patterns says, `holder`: nothing for the sample, else as `put` takes it while views are
//! captured by hand (`mirror 15 120`, `lambert:0.98`).
//!
//! In place of the folder there may be a screen that a window fills: a photodiode looks at it, and what it shows is what is lit.
//!
//! # Tradeoffs
//! Noise is a function of the pictures that are shown, and of how often the same sequence was shown before. So the images are those of the
//! simulated measurement, to the bit, as long as nothing is taken again. What a window shows next nobody
//! knows beforehand: there the images are those of the simulated measurement without noise only.

use std::collections::BTreeMap;
use std::fs;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::io;
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rcg::calibrate::by_hand::held_of;
use rcg::capture::camera::{Camera as _, CameraError};
use rcg::capture::files::{CURRENT, READY, name_of, read_pattern};
use rcg::capture::projector::{Projector as _, ProjectorError};
use rcg::instrument::drivers::{CameraDriver, Genicam, Trigger};
use rcg::instrument::rig::Rig;
use rcg::plan::Virtual;
use rcg::plan::pattern::BitPattern;
use rcg::virtual_rig::setup::{SetupError, World};
use rcg::virtual_rig::{Held, VirtualCamera, VirtualProjector, Wires};

use crate::bridge::{Bridge, BridgeError};
use crate::dlpc900::{Dlpc900, Sequence, Served};
use crate::dut::EmulatedPico;
use crate::gige::{Counts, Faults, GigeCamera, GigeError, PixelFormat, Settings};
pub use crate::projection::{Projection, Screen};

/// Name of the file that says what stands in the holder.
pub const HOLDER: &str = "holder";
/// How often the folder of patterns and the camera are looked at.
const LOOK: Duration = Duration::from_millis(2);

/// Why there is no table, or no longer.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The emulated Pico.
    #[error(transparent)]
    Bridge(#[from] BridgeError),
    /// The virtual rig.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The camera on the network.
    #[error(transparent)]
    Gige(#[from] GigeError),
    /// The virtual camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The patterns.
    #[error(transparent)]
    Projector(#[from] ProjectorError),
    /// What is to stand in the holder.
    #[error("holder: {0}")]
    Holder(String),
    /// The port of the projector.
    #[error("projector: {0}")]
    Port(io::Error),
    /// The answer to those who hand patterns over.
    #[error("{}: {source}", path.display())]
    Ready {
        /// Its file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// What stands on the table. It is cleared when this is dropped.
pub struct Table {
    rig: Rig,
    /// There until the table is cleared.
    bridge: Option<Bridge>,
    slot: Arc<Mutex<Slot>>,
    over: Arc<AtomicBool>,
    workers: Vec<JoinHandle<Result<(), TableError>>>,
    /// The projector's port, where it has one.
    _projector: Option<Served>,
}

impl Table {
    /// Lays a table: `dut` as trigger box, a camera with `settings` but for its sensor and formats, and the patterns in `folder`.
    /// `rig` is the instrument, its camera's image of the size that is to be stored, and `light` what the virtual rig shows.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn lay(
        rig: &Rig,
        light: &Virtual,
        dut: &EmulatedPico,
        settings: Settings,
        folder: &Path,
    ) -> Result<Self, TableError> {
        Self::lay_with(rig, light, dut, settings, Projection::Folder(folder))
    }

    /// As [`lay`](Self::lay), with another `projection` in place of the folder. Before a screen the sample stands in the holder.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn lay_with(
        rig: &Rig,
        light: &Virtual,
        dut: &EmulatedPico,
        settings: Settings,
        projection: Projection,
    ) -> Result<Self, TableError> {
        let mut rig = rig.clone();
        let (format, name) = format_of(&rig);
        let served = match &projection {
            Projection::Mirrors(unit, _) => Some(unit.serve().map_err(TableError::Port)?),
            _ => None,
        };
        projection.equip(&mut rig, served.as_ref());
        let (bridge, shown) = match projection {
            Projection::Folder(folder) => (Bridge::start(dut, 0)?, Ok((folder, None))),
            Projection::Mirrors(unit, folder) => (Bridge::start(dut, 0)?, Ok((folder, Some(unit)))),
            Projection::Screen(screen) => {
                let bridge = Bridge::start_before(dut, 0, Some(screen.photodiode))?;
                (bridge, Err(screen.projector))
            }
        };
        let settings = Settings {
            sensor_px: (rig.camera.lens.width_px, rig.camera.lens.height_px),
            formats: vec![format],
            ..settings
        };
        let rig = equipped(rig, settings.address, name, bridge.port());
        let slot = Arc::new(Mutex::new(Slot {
            camera: Some(GigeCamera::start(settings.clone())?),
            settings,
            format,
            dies_after: None,
            faults_after: None,
        }));

        let world = World::read(light, None)?;
        let wires = Wires::connect(&bridge.wires().to_string()).map_err(SetupError::from)?;
        let bare = rig.without_drivers();
        let sample = Held::Sample(world.sample.clone());
        let (camera, projector) = world.optics(&bare, sample, wires)?;
        let camera = Arc::new(Mutex::new(Some(camera)));
        let over = Arc::new(AtomicBool::new(false));
        let mut workers = Vec::new();
        match shown {
            Ok((folder, unit)) => {
                let mut shown = Shown {
                    rig: bare,
                    world,
                    wires: bridge.wires().to_string(),
                    holder: folder.with_file_name(HOLDER),
                    held: String::new(),
                    folder: folder.to_owned(),
                    projector,
                    camera: Arc::clone(&camera),
                    sequence: None,
                    times: BTreeMap::new(),
                };
                let over = Arc::clone(&over);
                workers.push(match unit {
                    Some(unit) => {
                        let failed = shown.follow(unit);
                        thread::spawn(move || until(&over, || lock(&failed).take().map_or(Ok(()), Err)))
                    }
                    None => thread::spawn(move || until(&over, || shown.load())),
                });
            }
            Err(seen_by) => {
                // Which patterns come nobody knows beforehand: all of them are one run.
                if let Some(camera) = lock(&camera).as_mut() {
                    camera.arm()?;
                }
                *lock(&seen_by) = Some(projector);
            }
        }
        workers.push({
            let (over, slot) = (Arc::clone(&over), Arc::clone(&slot));
            thread::spawn(move || until(&over, || pass_on(&camera, &slot)))
        });
        Ok(Self {
            rig,
            bridge: Some(bridge),
            slot,
            over,
            workers,
            _projector: served,
        })
    }

    /// The rig file of what stands on the table.
    #[must_use]
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Network address of the camera.
    #[must_use]
    pub fn address(&self) -> Ipv4Addr {
        lock(&self.slot).settings.address
    }

    /// What the camera has done so far; nothing where it is dead.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let slot = lock(&self.slot);
        slot.camera.as_ref().map(GigeCamera::counts).unwrap_or_default()
    }

    /// Says what goes wrong with the camera on purpose from now on.
    pub fn set_faults(&self, faults: Faults) {
        if let Some(camera) = &lock(&self.slot).camera {
            camera.set_faults(faults);
        }
    }

    /// Lets the camera lose its power after so many further frames.
    pub fn die_after(&self, frames: u64) {
        lock(&self.slot).dies_after = Some(frames);
    }

    /// Says what goes wrong with the camera on purpose after so many further frames.
    pub fn set_faults_after(&self, frames: u64, faults: Faults) {
        lock(&self.slot).faults_after = Some((frames, faults));
    }

    /// Switches the camera on again: a new one, of which nobody has set anything.
    ///
    /// # Errors
    /// [`GigeError`].
    pub fn revive(&self) -> Result<(), GigeError> {
        let mut slot = lock(&self.slot);
        slot.dies_after = None;
        slot.faults_after = None;
        slot.camera = None;
        slot.camera = Some(GigeCamera::start(slot.settings.clone())?);
        Ok(())
    }

    /// Whether all of it works.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.bridge.as_ref().is_some_and(Bridge::is_running)
            && !self.workers.iter().any(JoinHandle::is_finished)
    }

    /// Clears the table. Returns the firmware's log, as it came over RTT.
    ///
    /// # Errors
    /// [`TableError`] that had ended it before.
    pub fn clear(mut self) -> Result<Vec<u8>, TableError> {
        self.over.store(true, Ordering::Relaxed);
        for worker in self.workers.drain(..) {
            worker.join().expect("workers do not panic")?;
        }
        // The Pico goes last: the others hold its wires.
        let bridge = self.bridge.take().expect("invariant: it is taken here only");
        Ok(bridge.stop()?)
    }
}

impl Drop for Table {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Does `work` again and again until it is `over`.
fn until(over: &AtomicBool, mut work: impl FnMut() -> Result<(), TableError>) -> Result<(), TableError> {
    while !over.load(Ordering::Relaxed) {
        work()?;
        thread::sleep(LOOK);
    }
    Ok(())
}

/// The pixel format of `rig`'s camera, and its name.
fn format_of(rig: &Rig) -> (PixelFormat, &'static str) {
    let format = match (rig.camera.channels, rig.camera.bits) {
        (1, 8) => PixelFormat::Mono8,
        (1, 12) => PixelFormat::Mono12,
        (1, _) => PixelFormat::Mono16,
        (_, 8) => PixelFormat::Rgb8,
        _ => PixelFormat::Rgb16,
    };
    (format, format.name())
}

/// `rig` with the camera and the trigger box that stand on the table.
fn equipped(mut rig: Rig, camera: Ipv4Addr, format: &str, port: &str) -> Rig {
    rig.camera.driver = CameraDriver::Genicam;
    rig.camera.genicam = Some(Genicam {
        device: Some(camera.to_string()),
        region_px: Some([0, 0, rig.camera.lens.width_px, rig.camera.lens.height_px]),
        pixel_format: Some(format.to_owned()),
        ..Genicam::default()
    });
    rig.trigger = Some(Trigger {
        port: port.to_owned(),
        ..Trigger::default()
    });
    rig
}

/// Where the camera stands.
struct Slot {
    /// The camera, while it has power.
    camera: Option<GigeCamera>,
    settings: Settings,
    format: PixelFormat,
    /// After how many further frames it has none.
    dies_after: Option<u64>,
    /// After how many further frames what goes wrong.
    faults_after: Option<(u64, Faults)>,
}

/// Sends the frames that are exposed.
fn pass_on(camera: &Mutex<Option<VirtualCamera>>, slot: &Mutex<Slot>) -> Result<(), TableError> {
    let next = || {
        lock(camera)
            .as_mut()
            .map_or(Ok(None), |camera| camera.next_frame(Duration::ZERO))
    };
    while let Some(frame) = next()? {
        let mut slot = lock(slot);
        if slot.dies_after == Some(0) {
            slot.camera = None;
        }
        slot.dies_after = slot.dies_after.map(|left| left.saturating_sub(1));
        let faults = slot.faults_after.take_if(|(left, _)| *left == 0);
        if let Some((left, _)) = &mut slot.faults_after {
            *left -= 1;
        }
        let Some(camera) = &slot.camera else { continue };
        if let Some((_, faults)) = faults {
            camera.set_faults(faults);
        }
        let timestamp_ns = (frame.timestamp_s * 1e9).round() as u64;
        let exposure_us = camera.config().exposure_us;
        camera.expose(&slot.format.pack(&frame.dn), timestamp_ns, exposure_us)?;
    }
    Ok(())
}

/// The projector: shows the pictures of a folder, one after the other.
struct Shown {
    rig: Rig,
    world: World,
    wires: String,
    /// The file that says what stands in the holder, and what it said.
    holder: PathBuf,
    held: String,
    folder: PathBuf,
    projector: VirtualProjector,
    camera: Arc<Mutex<Option<VirtualCamera>>>,
    /// Name of the sequence that is shown.
    sequence: Option<String>,
    /// How often sequences were shown, by their content.
    times: BTreeMap<u64, u64>,
}

impl Shown {
    /// Puts into the holder what its file says, if that is something else.
    fn change_held(&mut self) -> Result<(), TableError> {
        let text = fs::read_to_string(&self.holder).unwrap_or_default();
        let text = text.trim();
        if text == self.held {
            return Ok(());
        }
        let held = match text {
            "" => Held::Sample(self.world.sample.clone()),
            text => held_of(text, &self.rig).map_err(TableError::Holder)?,
        };
        // The wires bear one rig at a time.
        *lock(&self.camera) = None;
        let wires = Wires::connect(&self.wires).map_err(SetupError::from)?;
        let (camera, projector) = self.world.optics(&self.rig, held, wires)?;
        *lock(&self.camera) = Some(camera);
        self.projector = projector;
        self.times.clear();
        text.clone_into(&mut self.held);
        Ok(())
    }

    /// Shows these patterns one after the other from the next edge on.
    fn show(&mut self, patterns: &[BitPattern]) -> Result<(), TableError> {
        self.change_held()?;
        self.projector.clear()?;
        let mut hasher = DefaultHasher::new();
        for pattern in patterns {
            self.projector.load(pattern)?;
            (pattern.bytes(), pattern.level(), pattern.primary()).hash(&mut hasher);
        }
        let times = self.times.entry(hasher.finish()).or_default();
        if let Some(camera) = lock(&self.camera).as_mut() {
            camera.begin_part(*times);
            camera.arm()?;
        }
        *times += 1;
        Ok(())
    }

    /// Shows what starts on `unit`. Returns where to look for what went wrong.
    fn follow(mut self, unit: &Dlpc900) -> Arc<Mutex<Option<TableError>>> {
        let failed = Arc::new(Mutex::new(None));
        let place = Arc::clone(&failed);
        unit.on_start(Box::new(move |sequence: Sequence| {
            let patterns: Vec<BitPattern> = sequence.into_iter().map(|shown| shown.pattern).collect();
            if let Err(error) = self.show(&patterns) {
                *lock(&place) = Some(error);
            }
        }));
        failed
    }

    /// Takes up a sequence that has come, and says so.
    fn load(&mut self) -> Result<(), TableError> {
        let current = fs::read_to_string(self.folder.join(CURRENT)).unwrap_or_default();
        let current = current.trim();
        if current.is_empty() || self.sequence.as_deref() == Some(current) {
            return Ok(());
        }
        let mut patterns = Vec::new();
        for number in 0.. {
            let path = self.folder.join(current).join(name_of(number));
            if !path.is_file() {
                break;
            }
            patterns.push(read_pattern(&path)?);
        }
        self.show(&patterns)?;
        let ready = self.folder.join(READY);
        fs::write(&ready, current).map_err(|source| TableError::Ready { path: ready, source })?;
        self.sequence = Some(current.to_owned());
        Ok(())
    }
}

/// An address of this machine of its own for the camera, for each process and call another.
#[must_use]
pub fn own_address() -> Ipv4Addr {
    use std::sync::atomic::AtomicU8;
    static NEXT: AtomicU8 = AtomicU8::new(1);
    let [high, low] = (std::process::id() as u16).to_be_bytes();
    Ipv4Addr::new(127, high.max(1), low, NEXT.fetch_add(1, Ordering::Relaxed))
}
