//! Pulses of PHOTO, as they are told to the host.
//!
//! # Design
//! Pulses are numbered, so that those that had no room on the way are seen to be missing: between two events by the number of the
//! second, which is an event without pulses at the end of the run.

use heapless::Vec;
use rcg_protocol::{Event, Input, PULSES_PER_EVENT, Photo, PhotoPulse, Ticks};

use super::Session;
use super::reports::RESERVED;

/// Pulses that wait to be told of.
#[derive(Clone, Debug)]
pub(super) struct PhotoLog {
    /// Since when the line is active.
    on: Option<Ticks>,
    /// When the first that waits ended.
    since: Ticks,
    /// Its number.
    first: u32,
    waiting: Vec<PhotoPulse, PULSES_PER_EVENT>,
}

impl PhotoLog {
    pub(super) const fn new() -> Self {
        Self {
            on: None,
            since: Ticks::ZERO,
            first: 0,
            waiting: Vec::new(),
        }
    }

    /// Forgets the run.
    pub(super) fn clear(&mut self) {
        *self = Self::new();
    }

    /// Whether pulses have waited for longer than `most` at `now`, from the start of the run.
    pub(super) fn has_waited(&self, now: Ticks, most: Ticks) -> bool {
        !self.waiting.is_empty() && now.saturating_sub(self.since) > most
    }
}

impl Session {
    /// What stands at PHOTO: to be told before [`rcg_protocol::Request::Photo`] is passed on.
    pub fn photo_seen(&mut self, input: Input) {
        self.photo_input = input;
    }

    pub(super) fn photo_now(&self) -> Photo {
        Photo {
            input: self.photo_input,
            pulses: self.photo.first + self.photo.waiting.len() as u32,
        }
    }

    /// PHOTO became active (or went to rest) at `at`, from the start of the run. What was active before the run is no pulse.
    pub fn photo(&mut self, active: bool, at: Ticks) {
        if active {
            self.photo.on = Some(at);
        } else if let Some(on) = self.photo.on.take() {
            self.tell_photo(on, Some(at.saturating_sub(on)), at);
        }
    }

    fn tell_photo(&mut self, on: Ticks, width: Option<Ticks>, now: Ticks) {
        if self.photo.waiting.is_empty() {
            self.photo.since = now;
        }
        self.photo.waiting.push(PhotoPulse { on, width }).ok(); // flushed when full, so there is room
        if self.photo.waiting.is_full() {
            self.flush_photo();
        }
    }

    /// The run is over.
    pub(super) fn end_photo(&mut self, at: Ticks) {
        if let Some(on) = self.photo.on.take() {
            self.tell_photo(on, None, at);
        }
        self.flush_photo();
        // Of a burst there are no stamps, and it says nothing.
        if self.sequencer.aux().photo && self.witnessed {
            // How many there were, so that those which were lost at the end are seen to be missing.
            self.send_event(Event::Photo {
                run: self.sequencer.run(),
                first: self.photo.first,
                pulses: Vec::new(),
            });
        }
    }

    pub(super) fn flush_photo(&mut self) {
        let pulses = core::mem::take(&mut self.photo.waiting);
        let first = self.photo.first;
        self.photo.first += pulses.len() as u32;
        if !pulses.is_empty() && self.outbox.room() > RESERVED {
            let run = self.sequencer.run();
            self.send_event(Event::Photo { run, first, pulses });
        }
    }
}
