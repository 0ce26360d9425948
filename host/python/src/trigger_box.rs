//! The trigger box.

use std::sync::{Mutex, MutexGuard};

use numpy::{IntoPyArray as _, PyArray1};
use pyo3::prelude::*;
use rcg::capture::device::{Device, DeviceError, Patience as Retries};
use rcg::capture::link::{self, Link};
use rcg::capture::records::flag_names;
use rcg::capture::steps::{Bracket, Limits, Span};
use rcg::instrument::rig::Rig;
use rcg::virtual_rig::VirtualController;
use rcg_protocol::{Event, Extent, Micros, Pace, Polarity, Program, Start, State, StepFlags, StepRecord};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::long_work::{self, Patience};

/// A host cannot be sure to be heard in less.
const SHORTEST_DEAD_MAN: Micros = Micros(20_000);

type Connected = Device<Box<dyn Link>>;

/// A connected trigger box; one thread talks to it at a time.
#[pyclass(frozen, module = "rcg._rcg")]
pub(crate) struct TriggerBox {
    rig: Rig,
    device: Mutex<Option<Connected>>,
}

/// A schedule as Python asks for it; times with their units, as [`Span`] reads them.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Schedule {
    steps: u32,
    exposures: Vec<String>,
    period: Option<String>,
    cam_at: Option<String>,
    proj_width: Option<String>,
    stream: bool,
    start_on_sync: bool,
    each_on_sync: bool,
    sync_timeout: Option<String>,
    dead_man: Option<String>,
    active_low: Vec<String>,
}

/// Step records, column by column: step, trigger, delay and width of the strobe (NaN where there was none) in ticks, flags.
type Columns<'py> = (
    Bound<'py, PyArray1<u64>>,
    Bound<'py, PyArray1<u64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<u8>>,
);

#[pymethods]
impl TriggerBox {
    #[new]
    fn new(py: Python<'_>, port: &str, rig: &str) -> PyResult<Self> {
        long_work::run(py, |_| {
            let rig = Rig::load(rig)?;
            let link: Box<dyn Link> = if port == "sim" {
                Box::new(VirtualController::alone(&rig))
            } else {
                link::open(port)?
            };
            let device = Device::connect(link, link::nonce(), Retries::default())?;
            Ok(Self {
                rig,
                device: Mutex::new(Some(device)),
            })
        })
    }

    /// Ends the connection.
    fn close(&self, py: Python<'_>) {
        py.detach(|| drop(self.lock().take()));
    }

    /// What it is and can do, as JSON.
    fn info(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |device, _| {
            let info = device.info();
            let (major, minor, patch) = info.firmware;
            let clock_hz = f64::from(info.clock_hz);
            Ok(json!({
                "port": device.link().peer(),
                "protocol": device.protocol(),
                "firmware": format!("{major}.{minor}.{patch}"),
                "clock_hz": info.clock_hz,
                "max_steps": info.max_steps,
                "max_words": info.max_words,
                "shortest_pulse_ticks": info.shortest_free,
                "shortest_pulse_with_sync_ticks": info.shortest_sync,
                "longest_period_s": info.longest_period.0 as f64 / clock_hz,
            })
            .to_string())
        })
    }

    /// How things stand, as JSON.
    fn status(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |device, _| Ok(status(device)?.to_string()))
    }

    /// Ends a run at once; how things stand, as JSON.
    fn abort(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |device, _| {
            device.abort()?;
            Ok(status(device)?.to_string())
        })
    }

    /// Fires a schedule and waits for its end.
    fn run<'py>(&self, py: Python<'py>, schedule: &str) -> PyResult<Columns<'py>> {
        let schedule: Schedule = serde_json::from_str(schedule).map_err(Failure::input)?;
        let records = self.with(py, |device, patience| schedule.fire(device, &self.rig, patience))?;
        let strobe = |ticks: fn(&rcg_protocol::Strobe) -> u64| -> Vec<f64> {
            let of = |record: &StepRecord| {
                record
                    .strobe
                    .as_ref()
                    .map_or(f64::NAN, |strobe| ticks(strobe) as f64)
            };
            records.iter().map(of).collect()
        };
        let steps: Vec<u64> = records.iter().map(|record| record.step.0).collect();
        let triggers: Vec<u64> = records.iter().map(|record| record.trigger.0).collect();
        let flags: Vec<u8> = records.iter().map(|record| record.flags.0).collect();
        Ok((
            steps.into_pyarray(py),
            triggers.into_pyarray(py),
            strobe(|strobe| strobe.delay.0).into_pyarray(py),
            strobe(|strobe| strobe.width.0).into_pyarray(py),
            flags.into_pyarray(py),
        ))
    }

    /// Names of the flags of a record by their bits.
    #[staticmethod]
    fn flags() -> Vec<(u8, String)> {
        let names = (0..8).map(|bit| 1 << bit).flat_map(|flag| {
            let names = flag_names(StepFlags(flag));
            names.into_iter().map(move |name| (flag, name))
        });
        names.filter(|(_, name)| !name.starts_with("flag-")).collect()
    }
}

impl TriggerBox {
    fn lock(&self) -> MutexGuard<'_, Option<Connected>> {
        // A work that was interrupted leaves a device that answers.
        self.device
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// What `work` says of the device, without Python's lock.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Connected, &Patience) -> Result<T, Failure> + Send,
    ) -> PyResult<T> {
        long_work::run(py, |patience| match self.lock().as_mut() {
            Some(device) => work(device, patience),
            None => Err(Failure::input(
                "trigger box: expected a connected one, found one that was closed",
            )),
        })
    }
}

fn status(device: &mut Connected) -> Result<Value, Failure> {
    let status = device.status()?;
    let counters = &status.counters;
    Ok(json!({
        "state": status.state.to_string(),
        "run": status.run,
        "steps_done": status.steps_done,
        "fault": status.fault.map(|fault| fault.to_string()),
        "uptime_s": status.now.0 as f64 / f64::from(device.info().clock_hz),
        "records_lost": counters.records_lost,
        "spurious_strobes": counters.spurious_strobes,
    }))
}

/// Why a run broke off.
enum Broken {
    Device(DeviceError),
    Interrupted,
}

impl From<DeviceError> for Broken {
    fn from(error: DeviceError) -> Self {
        Self::Device(error)
    }
}

impl From<Broken> for Failure {
    fn from(broken: Broken) -> Self {
        match broken {
            Broken::Device(error) => error.into(),
            Broken::Interrupted => Self::failed("run: interrupted"),
        }
    }
}

impl Schedule {
    /// Fires it; the records of all steps.
    fn fire(
        &self,
        device: &mut Connected,
        rig: &Rig,
        patience: &Patience,
    ) -> Result<Vec<StepRecord>, Failure> {
        let pace = if self.each_on_sync {
            Pace::EachOnSync
        } else {
            Pace::FreeRunning
        };
        let given = |name, text: &Option<String>| text.as_deref().map(|text| span(name, text)).transpose();
        let exposures = self.exposures.iter().map(|text| span("exposures", text));
        let bracket = Bracket {
            exposures: exposures.collect::<Result<_, _>>()?,
            cam_at: given("cam_at", &self.cam_at)?,
            proj_width: given("proj_width", &self.proj_width)?,
            period: given("period", &self.period)?,
        };
        let steps = bracket.steps(rig, Limits::new(&device.info(), pace))?;
        let turn = steps.len() as u32;
        if self.steps == 0 || !self.steps.is_multiple_of(turn) {
            return Err(Failure::input(format!(
                "steps: expected a multiple of {turn}, the number of exposure times, found {}",
                self.steps
            )));
        }
        let program = self.program(pace, turn, device.info().clock_hz)?;
        let mut records = Vec::new();
        let event = |event: Option<&Event>| {
            if let Some(Event::Records { records: more, .. }) = event {
                records.extend(more.iter().copied());
            }
            if patience.is_over() {
                return Err(Broken::Interrupted);
            }
            Ok(())
        };
        let ending = if self.stream {
            let stream = steps.iter().copied().cycle().take(self.steps as usize);
            device.stream(&program, stream, event)?
        } else {
            device.play(&program, &steps, event)?
        };
        if let (State::Fault, Some(fault)) = (ending.state, ending.fault) {
            let (port, done) = (device.link().peer(), ending.steps_done);
            return Err(Failure::failed(format!(
                "port {port}: expected {} steps, found an end after {done}: {fault}",
                self.steps
            )));
        }
        Ok(records)
    }

    fn program(&self, pace: Pace, turn: u32, clock_hz: u32) -> Result<Program, Failure> {
        let micros = |name: &str, text: &Option<String>, least: Micros, default: Micros| {
            let Some(text) = text else { return Ok(default) };
            let span = span(name, text)?;
            let none = span.seconds(clock_hz) <= 0.0;
            let found = span.micros(clock_hz).filter(|micros| none || *micros >= least);
            found.ok_or_else(|| {
                let least_s = f64::from(least.0) * 1e-6;
                Failure::input(format!(
                    "{name}: expected 0 for none or from {least_s} s to 4294 s, found {span}"
                ))
            })
        };
        let low = |line: &str| self.active_low.iter().any(|one| one == line);
        let lines = ["proj", "cam", "sync", "strobe"];
        if let Some(other) = self.active_low.iter().find(|one| !lines.contains(&one.as_str())) {
            return Err(Failure::input(format!(
                "active_low: expected proj, cam, sync or strobe, found {other}"
            )));
        }
        Ok(Program {
            extent: if self.stream {
                Extent::Stream
            } else {
                Extent::Table {
                    steps: turn,
                    cycles: self.steps / turn,
                }
            },
            start: if self.start_on_sync {
                Start::OnSync
            } else {
                Start::AtOnce
            },
            pace,
            polarity: Polarity {
                proj_active_low: low("proj"),
                cam_active_low: low("cam"),
                sync_active_low: low("sync"),
                strobe_active_low: low("strobe"),
            },
            sync_timeout: micros("sync_timeout", &self.sync_timeout, Micros(1), Micros(0))?,
            dead_man: micros(
                "dead_man",
                &self.dead_man,
                SHORTEST_DEAD_MAN,
                Micros::DEFAULT_DEAD_MAN,
            )?,
        })
    }
}

fn span(name: &str, text: &str) -> Result<Span, Failure> {
    let span = text.parse();
    span.map_err(|expected: &str| Failure::input(format!("{name}: {expected}, found {text}")))
}
