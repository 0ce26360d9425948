//! The columns that stand beside each raw frame: which exposure it was and when it happened.
//!
//! # Design
//! One small array per field, so that xarray shows each as a variable along `exposure`. The table
//! below is the only place that knows names, types, units and what stands for no data; the record and
//! its columns cannot drift apart. What stands for no data is no legal value, and declared
//! (`_FillValue`, CF conventions 1.11, §2.5.1); codes and bits say what they mean (§3.5).

use std::sync::Arc;

use bytemuck::Pod;
use rcg_protocol::StepFlags;
use serde_json::{Map, Value, json};
use zarrs::array::ElementOwned;

use super::array::{ArraySpec, ElementType, ZarrArray};
use super::atomic::AtomicStore;
use super::described::described;
use super::error::StoreError;
use super::header::Header;

/// What stands for no data in unsigned 64-bit arrays.
pub(super) const FILL_U64: u64 = u64::MAX;

/// Kinds of exposures: code and word.
pub const KINDS: [(u8, &str); 3] = [
    (0, "incident_direction"),
    (1, "black"),
    (2, "view_of_a_calibration"),
];

/// Bits of the controller's record, with the word for each.
const FLAGS: [(StepFlags, &str); 6] = [
    (StepFlags::MISSED, "missed_trigger"),
    (StepFlags::DOUBLE, "exposed_more_than_once"),
    (StepFlags::NO_TRIGGER, "no_trigger"),
    (StepFlags::OVERRUN, "exposure_overran"),
    (StepFlags::SYNC_MISSED, "sync_missed"),
    (StepFlags::SYNC_EXTRA, "sync_extra"),
];

/// Dimension of every column.
const DIMS: &[&str] = &["exposure"];

/// What is known about one exposure apart from its image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExposureRecord {
    /// Index of the incident direction in the plan, −1 for a dark or black-pattern frame, −2 for a black pattern
    /// without what watches the lamp, −3 and below for code patterns.
    pub incident: i64,
    /// Code of the kind of exposure, one of [`KINDS`].
    pub kind: u8,
    /// Exposure time in s.
    pub exposure_s: f64,
    /// Controller's time of the camera trigger, in ticks.
    pub trigger_tick: u64,
    /// Controller's time at which the camera began to expose, in ticks.
    pub strobe_on_tick: u64,
    /// Controller's time at which the camera ended to expose, in ticks.
    pub strobe_off_tick: u64,
    /// The camera's own number of the frame.
    pub frame_id: u64,
    /// Start of the exposure on the camera's own clock, in s; NaN if the camera has none.
    pub camera_timestamp_s: f64,
    /// How many times the exposure was tried until it succeeded, at least 1.
    pub attempts: u8,
    /// Bits of what went wrong or was special, those of the controller's record.
    pub flags: u16,
    /// Solid angle that was actually lit, at the sample, in sr; 0 for a black pattern, NaN if it was not
    /// found out.
    pub lit_solid_angle_sr: f64,
    /// Σ E·cosθ·Δω over the lit projector pixels, in sr × relative intensity; 0 and NaN as
    /// before.
    pub lit_irradiance: f64,
}

impl ExposureRecord {
    /// No data in any of its fields: an exposure that was never taken.
    pub const NONE: Self = Self {
        incident: i64::MIN,
        kind: u8::MAX,
        exposure_s: f64::NAN,
        trigger_tick: FILL_U64,
        strobe_on_tick: FILL_U64,
        strobe_off_tick: FILL_U64,
        frame_id: FILL_U64,
        camera_timestamp_s: f64::NAN,
        attempts: 0,
        flags: u16::MAX,
        lit_solid_angle_sr: f64::NAN,
        lit_irradiance: f64::NAN,
    };

    /// Of a frame of which nothing is known but what the camera says: its number and its time-stamp in s.
    #[must_use]
    pub const fn of_frame(frame_id: u64, camera_timestamp_s: f64) -> Self {
        Self {
            frame_id,
            camera_timestamp_s,
            attempts: 1,
            ..Self::NONE
        }
    }
}

/// All columns of a file, in the order of the record's fields.
#[derive(Debug)]
pub(super) struct RecordColumns(Vec<ZarrArray>);

/// Calls `$do!` with every field: name, type in memory, type in the file, units, what stands for no data, long name.
macro_rules! for_every_field {
    ($do:ident) => {
        $do! {
            incident: i64, I64, "1", json!(i64::MIN), "index of the incident direction in the plan, -1 = dark or black frame";
            kind: u8, U8, "1", json!(u8::MAX), "kind of exposure";
            exposure_s: f64, F64, "s", Value::Null, "exposure time";
            trigger_tick: u64, U64, TICK, json!(FILL_U64), "time of the camera trigger";
            strobe_on_tick: u64, U64, TICK, json!(FILL_U64), "start of the exposure";
            strobe_off_tick: u64, U64, TICK, json!(FILL_U64), "end of the exposure";
            frame_id: u64, U64, "1", json!(FILL_U64), "frame number of the camera";
            camera_timestamp_s: f64, F64, "s", Value::Null, "start of the exposure on the camera's own clock";
            attempts: u8, U8, "1", json!(0), "number of attempts";
            flags: u16, U16, "1", json!(u16::MAX), "flags of the exposure";
            lit_solid_angle_sr: f64, F64, "sr", Value::Null, "solid angle that was lit";
            lit_irradiance: f64, F64, "sr", Value::Null, "sum over the lit pixels of relative intensity * cosine * solid angle";
        }
    };
}

/// Unit of times on the controller's clock, whose rate stands beside it.
const TICK: &str = "tick";

/// Attributes of the column `name`; real numbers need no `fill`.
fn about(name: &str, units: &str, fill: Value, long_name: &str, clock_hz: u32) -> Map<String, Value> {
    let mut about = described(units, long_name);
    if !fill.is_null() {
        about.insert("_FillValue".into(), fill);
    }
    if units == TICK {
        about.insert("ticks_per_second".into(), clock_hz.into());
    }
    let words = |words: &[&str]| Value::from(words.join(" "));
    match name {
        "incident" => {
            about.insert("flag_values".into(), json!([-1]));
            about.insert("flag_meanings".into(), "black".into());
        }
        "kind" => {
            about.insert("flag_values".into(), json!(KINDS.map(|kind| kind.0)));
            about.insert("flag_meanings".into(), words(&KINDS.map(|kind| kind.1)));
        }
        "flags" => {
            about.insert("flag_masks".into(), json!(FLAGS.map(|flag| flag.0.0)));
            about.insert("flag_meanings".into(), words(&FLAGS.map(|flag| flag.1)));
        }
        _ => {}
    }
    about
}

macro_rules! columns_of_fields {
    ($($field:ident: $type:ty, $element:ident, $units:expr, $fill:expr, $long_name:literal;)*) => {
        /// Name, type, units, what stands for no data and long name of each column.
        fn fields() -> Vec<(&'static str, ElementType, &'static str, Value, &'static str)> {
            vec![$((stringify!($field), ElementType::$element, $units, $fill, $long_name)),*]
        }

        impl RecordColumns {
            /// Writes the records of chunk `index`, one column after the other.
            pub(super) fn write(&self, index: usize, records: &[ExposureRecord]) -> Result<(), StoreError> {
                let mut columns = self.0.iter();
                $(
                    let column = columns.next().expect("invariant: one column per field");
                    let values: Vec<$type> = records.iter().map(|record| record.$field).collect();
                    column.write(index, &values)?;
                )*
                Ok(())
            }

            /// Reads the records of chunk `index`; every column has to be there.
            pub(super) fn read(&self, index: usize) -> Result<Vec<ExposureRecord>, StoreError> {
                let mut records = vec![ExposureRecord::default(); self.0[0].range(index).len()];
                let mut columns = self.0.iter();
                $(
                    let column = columns.next().expect("invariant: one column per field");
                    for (record, value) in records.iter_mut().zip(read::<$type>(column, index)?) {
                        record.$field = value;
                    }
                )*
                Ok(records)
            }
        }
    };
}

for_every_field!(columns_of_fields);

fn read<T: ElementOwned + Pod>(column: &ZarrArray, index: usize) -> Result<Vec<T>, StoreError> {
    column.read_present(index)
}

fn spec(name: &'static str, element: ElementType, exposures: usize, segment: usize) -> ArraySpec<'static> {
    ArraySpec {
        name,
        element,
        shape: vec![exposures],
        chunk: segment,
        dims: DIMS,
        packed: false,
    }
}

impl RecordColumns {
    /// Makes the columns for `exposures` in chunks of `segment`; ticks are those of a clock of `clock_hz`.
    pub(super) fn create(
        store: &Arc<AtomicStore>,
        exposures: usize,
        segment: usize,
        clock_hz: u32,
    ) -> Result<Self, StoreError> {
        let columns = fields()
            .into_iter()
            .map(|(name, element, units, fill, long_name)| {
                ZarrArray::create(
                    store,
                    &spec(name, element, exposures, segment),
                    about(name, units, fill, long_name, clock_hz),
                )
            });
        columns.collect::<Result<_, _>>().map(Self)
    }

    /// Opens the columns, which have to be those of `exposures` in chunks of `segment`.
    pub(super) fn open(
        store: &Arc<AtomicStore>,
        exposures: usize,
        segment: usize,
    ) -> Result<Self, StoreError> {
        let columns = fields().into_iter().map(|(name, element, ..)| {
            let header = Header::read(store, name, Some(1))?;
            ZarrArray::open(store, &spec(name, element, exposures, segment), &header)
        });
        columns.collect::<Result<_, _>>().map(Self)
    }

    /// The columns' arrays.
    pub(super) fn arrays(&self) -> &[ZarrArray] {
        &self.0
    }
}
