//! The columns that stand beside each raw frame: which exposure it was and when it happened.
//!
//! # Design
//! One small array per field, so that xarray shows each as a variable along `exposure`. The table
//! below is the only place that knows names, types and units; the record and its columns
//! cannot drift apart.

use std::sync::Arc;

use zarrs::array::ElementOwned;

use super::array::{ArraySpec, ElementType, ZarrArray, described};
use super::atomic::AtomicStore;
use super::error::StoreError;
use super::header::Header;

/// Dimension of every column.
const DIMS: &[&str] = &["exposure"];

/// What is known about one exposure apart from its image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExposureRecord {
    /// Index of the incident direction in the plan, −1 for a dark or black-pattern frame.
    pub incident: i64,
    /// Code of the kind of exposure, given by the capture stage.
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
    /// How many times the exposure was tried until it succeeded.
    pub attempts: u8,
    /// Bits of what went wrong or was special, given by the capture stage.
    pub flags: u16,
    /// Solid angle that was actually lit, at the sample, in sr.
    pub lit_solid_angle_sr: f64,
    /// Σ E·cosθ·Δω over the lit projector pixels, in sr × relative intensity.
    pub lit_irradiance: f64,
}

/// All columns of a file, in the order of the record's fields.
#[derive(Debug)]
pub(super) struct RecordColumns(Vec<ZarrArray>);

/// Calls `$do!` with every field: name, type in memory, type in the file, units, long name.
macro_rules! for_every_field {
    ($do:ident) => {
        $do! {
            incident: i64, I64, "1", "index of the incident direction in the plan, -1 = dark or black frame";
            kind: u8, U8, "1", "kind of exposure";
            exposure_s: f64, F64, "s", "exposure time";
            trigger_tick: u64, U64, "tick", "time of the camera trigger";
            strobe_on_tick: u64, U64, "tick", "start of the exposure";
            strobe_off_tick: u64, U64, "tick", "end of the exposure";
            frame_id: u64, U64, "1", "frame number of the camera";
            attempts: u8, U8, "1", "number of attempts";
            flags: u16, U16, "1", "flags of the exposure";
            lit_solid_angle_sr: f64, F64, "sr", "solid angle that was lit";
            lit_irradiance: f64, F64, "sr", "sum over the lit pixels of relative intensity * cosine * solid angle";
        }
    };
}

macro_rules! columns_of_fields {
    ($($field:ident: $type:ty, $element:ident, $units:literal, $long_name:literal;)*) => {
        /// Name, type, units and long name of each column.
        const FIELDS: &[(&str, ElementType, &str, &str)] =
            &[$((stringify!($field), ElementType::$element, $units, $long_name)),*];

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

fn read<T: ElementOwned>(column: &ZarrArray, index: usize) -> Result<Vec<T>, StoreError> {
    column.read_present(index)
}

fn spec(name: &'static str, element: ElementType, exposures: usize, segment: usize) -> ArraySpec<'static> {
    ArraySpec {
        name,
        element,
        shape: vec![exposures],
        chunk: segment,
        dims: DIMS,
    }
}

impl RecordColumns {
    /// Makes the columns for `exposures` in chunks of `segment`.
    pub(super) fn create(
        store: &Arc<AtomicStore>,
        exposures: usize,
        segment: usize,
    ) -> Result<Self, StoreError> {
        let columns = FIELDS.iter().map(|&(name, element, units, long_name)| {
            ZarrArray::create(
                store,
                &spec(name, element, exposures, segment),
                described(units, long_name),
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
        let columns = FIELDS.iter().map(|&(name, element, ..)| {
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
