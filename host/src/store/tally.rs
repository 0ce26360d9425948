//! What happened on the way to the frames: counted by segments, and stored with them.
//!
//! # Design
//! Each count is an array along `segment`, and so are the frames that no trigger explains, each with its number and the
//! camera's time-stamp. They become valid with their segment's frames, and what is told of a whole measurement is always the
//! sum over stored segments: a capture that was killed and resumed tells the same as one that nothing disturbed.
//!
//! A segment names as many orphans as it has exposures; of more, which a camera that runs wild could send, the count tells.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::array::{ArraySpec, ElementType, ZarrArray};
use super::atomic::AtomicStore;
use super::described::described;
use super::error::StoreError;
use super::exposure_record::FILL_U64;
use super::header::Header;

/// A frame that no trigger explains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrphanFrame {
    /// The camera's own number of the frame.
    pub frame_id: u64,
    /// Start of its exposure on the camera's clock, s.
    pub timestamp_s: f64,
}

/// Arrays of the orphans.
const ORPHAN_ID: &str = "orphan_frame_id";
const ORPHAN_TIME: &str = "orphan_timestamp_s";

/// Calls `$do!` with every count: name and long name.
macro_rules! for_every_count {
    ($do:ident) => {
        $do! {
            paired: "exposures that were paired and kept";
            missed_triggers: "triggers that the camera ignored";
            dropped_frames: "exposures whose frame never came";
            lost_records: "steps whose record never came";
            disputed: "frames whose number and time contradicted each other";
            duplicates: "frames that came twice";
            orphans: "frames that belonged to no trigger";
            spurious_strobes: "exposures that nothing had triggered";
            repeated: "exposures that were taken again";
        }
    };
}

macro_rules! tally_of_counts {
    ($($count:ident: $long_name:literal;)*) => {
        /// What happened on the way.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default)]
        pub struct Tally {
            $(#[doc = $long_name] pub $count: u64,)*
            /// The frames that belonged to no trigger, in their order.
            #[serde(skip)]
            pub orphan_frames: Vec<OrphanFrame>,
        }

        const COUNTS: &[(&str, &str)] = &[$((stringify!($count), $long_name)),*];

        impl Tally {
            fn counts(&self) -> Vec<u64> {
                vec![$(self.$count),*]
            }

            fn of_counts(counts: &[u64]) -> Self {
                let mut counts = counts.iter().copied();
                Self {
                    $($count: counts.next().unwrap_or_default(),)*
                    orphan_frames: Vec::new(),
                }
            }

            /// Adds what happened in another part.
            pub fn add(&mut self, other: &Self) {
                $(self.$count += other.$count;)*
                self.orphan_frames.extend_from_slice(&other.orphan_frames);
            }
        }
    };
}

for_every_count!(tally_of_counts);

/// The tallies of all segments.
#[derive(Debug)]
pub(super) struct TallyColumns {
    counts: Vec<ZarrArray>,
    orphan_id: ZarrArray,
    orphan_time: ZarrArray,
    slots: usize,
}

fn count_spec(name: &'static str, segments: usize) -> ArraySpec<'static> {
    ArraySpec {
        name,
        element: ElementType::U64,
        shape: vec![segments],
        chunk: 1,
        dims: &["segment"],
        packed: false,
    }
}

fn orphan_spec(
    name: &'static str,
    element: ElementType,
    segments: usize,
    slots: usize,
) -> ArraySpec<'static> {
    ArraySpec {
        name,
        element,
        shape: vec![segments, slots],
        chunk: 1,
        dims: &["segment", "orphan"],
        packed: false,
    }
}

impl TallyColumns {
    /// Makes the columns for `segments`, each of which names up to `slots` orphans.
    pub(super) fn create(
        store: &Arc<AtomicStore>,
        segments: usize,
        slots: usize,
    ) -> Result<Self, StoreError> {
        let with_fill = |units: &str, long_name: &str| {
            let mut about = described(units, long_name);
            about.insert("_FillValue".into(), json!(FILL_U64));
            about
        };
        let counts = COUNTS.iter().map(|&(name, long_name)| {
            ZarrArray::create(store, &count_spec(name, segments), with_fill("1", long_name))
        });
        let id = orphan_spec(ORPHAN_ID, ElementType::U64, segments, slots);
        let time = orphan_spec(ORPHAN_TIME, ElementType::F64, segments, slots);
        Ok(Self {
            counts: counts.collect::<Result<_, _>>()?,
            orphan_id: ZarrArray::create(
                store,
                &id,
                with_fill("1", "the camera's number of a frame that belonged to no trigger"),
            )?,
            orphan_time: ZarrArray::create(
                store,
                &time,
                described(
                    "s",
                    "time on the camera's clock of a frame that belonged to no trigger",
                ),
            )?,
            slots,
        })
    }

    /// Opens the columns, which have to be those of `segments` with `slots` for orphans.
    pub(super) fn open(store: &Arc<AtomicStore>, segments: usize, slots: usize) -> Result<Self, StoreError> {
        let open = |spec: &ArraySpec<'_>| {
            let header = Header::read(store, spec.name, Some(spec.shape.len()))?;
            ZarrArray::open(store, spec, &header)
        };
        let counts = COUNTS.iter().map(|&(name, _)| open(&count_spec(name, segments)));
        Ok(Self {
            counts: counts.collect::<Result<_, _>>()?,
            orphan_id: open(&orphan_spec(ORPHAN_ID, ElementType::U64, segments, slots))?,
            orphan_time: open(&orphan_spec(ORPHAN_TIME, ElementType::F64, segments, slots))?,
            slots,
        })
    }

    /// The columns' arrays.
    pub(super) fn arrays(&self) -> impl Iterator<Item = &ZarrArray> {
        self.counts.iter().chain([&self.orphan_id, &self.orphan_time])
    }

    /// Writes the tally of segment `index`.
    pub(super) fn write(&self, index: usize, tally: &Tally) -> Result<(), StoreError> {
        for (column, count) in self.counts.iter().zip(tally.counts()) {
            column.write(index, &[count])?;
        }
        let mut ids: Vec<u64> = tally.orphan_frames.iter().map(|orphan| orphan.frame_id).collect();
        let mut times: Vec<f64> = tally
            .orphan_frames
            .iter()
            .map(|orphan| orphan.timestamp_s)
            .collect();
        ids.resize(self.slots, FILL_U64);
        times.resize(self.slots, f64::NAN);
        self.orphan_id.write(index, &ids)?;
        self.orphan_time.write(index, &times)
    }

    /// Reads the tally of segment `index`; every column has to be there.
    pub(super) fn read(&self, index: usize) -> Result<Tally, StoreError> {
        let counts = self.counts.iter().map(|column| column.read_present::<u64>(index));
        let counts: Vec<u64> = counts.collect::<Result<Vec<_>, _>>()?.concat();
        let mut tally = Tally::of_counts(&counts);
        let ids = self.orphan_id.read_present::<u64>(index)?;
        let times = self.orphan_time.read_present::<f64>(index)?;
        let named = self
            .slots
            .min(usize::try_from(tally.orphans).unwrap_or(usize::MAX));
        tally.orphan_frames = ids
            .into_iter()
            .zip(times)
            .take(named)
            .map(|(frame_id, timestamp_s)| OrphanFrame {
                frame_id,
                timestamp_s,
            })
            .collect();
        Ok(tally)
    }
}
