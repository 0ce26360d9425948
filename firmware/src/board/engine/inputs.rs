//! What stands at the inputs.

use rcg_protocol::{Input, Inputs, Line};

use super::Engine;

impl Engine {
    /// Notes which edges have come, for [`seen`](Self::seen); to be called every millisecond.
    pub(crate) fn note_edges(&mut self) {
        let elapsed = self.clock.now().saturating_sub(self.counts_since);
        self.strobe.note(elapsed);
        self.sync.note(elapsed);
        self.photo.note(elapsed);
    }

    /// As [`inputs`](rcg_firmware::control::PulseEngine::inputs).
    pub(super) fn seen(&mut self) -> Inputs {
        self.note_edges();
        Inputs {
            at: self.clock.now(),
            since: self.counts_since,
            sync: match self.begins_on {
                Line::Start => self.sync.unwatched(self.polarity.sync_active_low),
                _ => self.sync.seen(self.counts_since),
            },
            strobe: self.strobe.seen(self.counts_since),
        }
    }

    /// As [`photo`](rcg_firmware::control::PulseEngine::photo).
    pub(super) fn seen_photo(&mut self) -> Input {
        self.note_edges();
        self.photo.seen(self.counts_since)
    }
}
