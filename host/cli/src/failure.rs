//! What went wrong, and the exit code that says of what kind it is.

use std::io;

use rcg::assemble::AssembleError;
use rcg::assemble::fill::FillError;
use rcg::base::file_format::FormatError;
use rcg::brdf::BrdfError;
use rcg::brdf::SourceError;
use rcg::brdf::sample::SampleError;
use rcg::calibrate::CalibrateError;
use rcg::capture::device::DeviceError;
use rcg::capture::firing::FiringError;
use rcg::capture::link::LinkError;
use rcg::capture::measurement::MeasurementError;
use rcg::capture::records::RecordsError;
use rcg::instrument::calibration::CalibrationError;
use rcg::instrument::rig::RigError;
use rcg::judge::chart::ChartError;
use rcg::judge::fit::FitError;
use rcg::judge::render::PictureError;
use rcg::measure::MeasureError;
use rcg::measure::adaptive::AdaptiveError;
use rcg::plan::PlanError;
use rcg::store::StoreError;
use rcg::store::whole_file::FileError;
use rcg::study::StudyError;
use rcg::study::multiplex::MultiplexError;
use rcg::study::paper::PaperError;
use rcg::virtual_rig::WiresError;
use rcg::virtual_rig::setup::SetupError;

/// A failed command.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The user's input is wrong: exit 2.
    Input(anyhow::Error),
    /// Something failed: exit 1.
    Failed(anyhow::Error),
    /// Something failed, and this is how far it got: exit 1.
    Partly(anyhow::Error, serde_json::Value),
}

impl Failure {
    /// Wrong input in one sentence.
    pub(crate) fn input(sentence: impl std::fmt::Display) -> Self {
        Self::Input(anyhow::anyhow!("{sentence}"))
    }

    /// The same failure of the thing at `place`, which its sentence names.
    pub(crate) fn at(self, place: impl std::fmt::Display) -> Self {
        let (place, sentence) = (place.to_string(), self.to_string());
        if sentence.contains(&place) {
            return self;
        }
        let error = anyhow::anyhow!("{place}: {sentence}");
        match self {
            Self::Input(_) => Self::Input(error),
            Self::Failed(_) => Self::Failed(error),
            Self::Partly(_, facts) => Self::Partly(error, facts),
        }
    }

    /// The exit code.
    pub(crate) const fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Failed(_) | Self::Partly(..) => 1,
        }
    }

    const fn error(&self) -> &anyhow::Error {
        match self {
            Self::Input(error) | Self::Failed(error) | Self::Partly(error, _) => error,
        }
    }

    /// What is to be printed with `--json` beside the error; an object or null.
    pub(crate) fn facts(&self) -> serde_json::Value {
        match self {
            Self::Partly(_, facts) => facts.clone(),
            _ => serde_json::Value::Null,
        }
    }

    /// Whether the reader of our output has gone, which is no failure.
    pub(crate) fn is_broken_pipe(&self) -> bool {
        let io = self.error().downcast_ref::<io::Error>();
        io.is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.error())
    }
}

/// Whether an error is of the user's making.
trait Blame: std::error::Error + Send + Sync + Sized + 'static {
    fn is_input(&self) -> bool;
}

impl Blame for FileError {
    fn is_input(&self) -> bool {
        false
    }
}

impl Blame for RigError {
    fn is_input(&self) -> bool {
        true
    }
}

impl Blame for SampleError {
    fn is_input(&self) -> bool {
        true
    }
}

impl Blame for PlanError {
    fn is_input(&self) -> bool {
        true
    }
}

impl Blame for StoreError {
    fn is_input(&self) -> bool {
        !matches!(
            self,
            Self::DiskFull { .. } | Self::Io { .. } | Self::Argument { .. } | Self::Busy { .. }
        )
    }
}

impl Blame for BrdfError {
    fn is_input(&self) -> bool {
        match self {
            Self::Store(error) => error.is_input(),
            Self::Content { .. } => true,
        }
    }
}

impl Blame for CalibrationError {
    fn is_input(&self) -> bool {
        true
    }
}

impl Blame for CalibrateError {
    fn is_input(&self) -> bool {
        match self {
            Self::Setup(error) => error.is_input(),
            Self::Measurement(error) => error.is_input(),
            Self::Store(error) => error.is_input(),
            Self::File(_) | Self::Picture(_) => false,
            Self::Rig(_) | Self::Found(_) | Self::Views { .. } => true,
        }
    }
}

impl Blame for FillError {
    fn is_input(&self) -> bool {
        match self {
            Self::Brdf(error) => error.is_input(),
            Self::Store(error) => error.is_input(),
            Self::Fit(error) => error.is_input(),
            Self::Differs { .. } | Self::NoOverlap { .. } | Self::Nothing { .. } => true,
        }
    }
}

impl Blame for LinkError {
    fn is_input(&self) -> bool {
        matches!(
            self,
            Self::NoSuchPort { .. } | Self::NoTriggerBox { .. } | Self::SeveralTriggerBoxes { .. }
        )
    }
}

impl Blame for DeviceError {
    fn is_input(&self) -> bool {
        match self {
            Self::Link(error) => error.is_input(),
            Self::TooLong { .. } => true,
            Self::Refused { fault, .. } => {
                use rcg_protocol::Fault;
                matches!(
                    fault,
                    Fault::EdgesTooClose { .. }
                        | Fault::PulseOutsidePeriod { .. }
                        | Fault::PeriodTooLong { .. }
                        | Fault::EmptySchedule
                        | Fault::TooManySteps { .. }
                        | Fault::TooManyWords { .. }
                )
            }
            _ => false,
        }
    }
}

impl Blame for MeasurementError {
    fn is_input(&self) -> bool {
        match self {
            Self::Exists { .. }
            | Self::NotOne { .. }
            | Self::Differs { .. }
            | Self::Changed { .. }
            | Self::Manifest { .. }
            | Self::Rig(_)
            | Self::Plan(_)
            | Self::Calibration(_) => true,
            Self::Store(error) => error.is_input(),
            Self::File(_) | Self::Capture(_) => false,
        }
    }
}

impl Blame for SetupError {
    fn is_input(&self) -> bool {
        match self {
            Self::Plan(_) | Self::Truth(_) | Self::Sample(_) => true,
            Self::Device(error) => error.is_input(),
            Self::Wires(error) => matches!(error, WiresError::Address { .. }),
        }
    }
}

impl Blame for MeasureError {
    fn is_input(&self) -> bool {
        match self {
            Self::Measurement(error) => error.is_input(),
            Self::Brdf(error) | Self::Assemble(AssembleError::Brdf(error)) => error.is_input(),
            Self::Sample(_) | Self::Assemble(AssembleError::Mismatch { .. }) => true,
            Self::Calibration(error) => error.is_input(),
            Self::Setup(error) => error.is_input(),
            Self::Assemble(AssembleError::Store(error)) => error.is_input(),
            Self::Report(_) => false,
        }
    }
}

impl Blame for AdaptiveError {
    fn is_input(&self) -> bool {
        match self {
            Self::Goal(_) | Self::Toml(_) | Self::Differs { .. } | Self::OutOfReach { .. } => true,
            Self::Measure(error) => error.is_input(),
            Self::NothingSeen { .. } => false,
        }
    }
}

impl Blame for MultiplexError {
    fn is_input(&self) -> bool {
        match self {
            Self::Cells(_) => true,
            Self::Measurement(error) => error.is_input(),
        }
    }
}

impl Blame for FitError {
    fn is_input(&self) -> bool {
        match self {
            Self::Store(error) => error.is_input(),
            Self::TooFew { .. } | Self::OneSided { .. } | Self::NoLobe { .. } => true,
        }
    }
}

impl Blame for FiringError {
    fn is_input(&self) -> bool {
        true
    }
}

impl Blame for SourceError {
    fn is_input(&self) -> bool {
        match self {
            Self::Brdf(error) => error.is_input(),
            Self::Sample(_) => true,
        }
    }
}

impl Blame for FormatError {
    fn is_input(&self) -> bool {
        true
    }
}

impl Blame for PictureError {
    fn is_input(&self) -> bool {
        matches!(self, Self::Format(_))
    }
}

impl Blame for RecordsError {
    fn is_input(&self) -> bool {
        matches!(self, Self::Format(_))
    }
}

impl Blame for ChartError {
    fn is_input(&self) -> bool {
        match self {
            Self::Format(_) => true,
            Self::File(_) => false,
            Self::Picture(error) => error.is_input(),
        }
    }
}

impl Blame for StudyError {
    fn is_input(&self) -> bool {
        match self {
            Self::Store(error) => error.is_input(),
            Self::Chart(error) => error.is_input(),
            Self::TooLarge { .. } | Self::Interval(_) | Self::ImageSize(_) | Self::Exposure(_) => true,
        }
    }
}

impl Blame for PaperError {
    fn is_input(&self) -> bool {
        match self {
            Self::Measure(error) => error.is_input(),
            Self::Study(error) => error.is_input(),
            Self::Chart(error) => error.is_input(),
        }
    }
}

impl<E: Blame> From<E> for Failure {
    fn from(error: E) -> Self {
        if error.is_input() {
            Self::Input(error.into())
        } else {
            Self::Failed(error.into())
        }
    }
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Failed(error.into())
    }
}
