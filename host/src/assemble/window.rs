//! Segments of raw frames: one thread reads them ahead, the window holds those that are needed.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::Scope;

use super::AssembleError;
use crate::store::{RawStore, Segment, StoreError};

/// Refuses a segment, by its number, that is not what the plan says.
pub(super) type Agree<'a> = dyn Fn(usize, &Segment) -> Result<(), AssembleError> + 'a;

/// The segments that one batch of chunks needs.
pub(super) struct Window {
    read: Receiver<Result<Segment, StoreError>>,
    /// By number.
    held: BTreeMap<usize, Segment>,
    /// Number of the segment that is read next.
    next: usize,
}

impl Window {
    /// Nothing of `reader` yet; a thread in `scope` reads ahead.
    pub(super) fn new<'scope>(scope: &'scope Scope<'scope, '_>, reader: RawStore) -> Self {
        let (tx, rx) = sync_channel::<Result<Segment, StoreError>>(2);
        scope.spawn(move || {
            for segment in 0..reader.segments() {
                if tx.send(reader.read_segment(segment)).is_err() {
                    break; // the receiver has failed and gone
                }
            }
        });
        Self {
            read: rx,
            held: BTreeMap::new(),
            next: 0,
        }
    }

    /// Holds the segments `needed` and drops those before; `mismatch` makes an error of a reason.
    pub(super) fn move_to(
        &mut self,
        needed: RangeInclusive<usize>,
        agree: &Agree<'_>,
        mismatch: impl Fn(String) -> AssembleError,
    ) -> Result<(), AssembleError> {
        let (low, high) = needed.into_inner();
        self.held.retain(|&segment, _| segment >= low);
        while self.next <= high {
            let segment = self
                .read
                .recv()
                .map_err(|_| mismatch("the reading thread has ended".to_owned()))??;
            agree(self.next, &segment)?;
            if self.next >= low {
                self.held.insert(self.next, segment);
            }
            self.next += 1;
        }
        Ok(())
    }

    /// The segments by their numbers.
    pub(super) const fn held(&self) -> &BTreeMap<usize, Segment> {
        &self.held
    }
}
