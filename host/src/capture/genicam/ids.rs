//! Numbers of frames from the ids of a stream's blocks.

/// Counts frames from the first of an acquisition on.
///
/// GigE Vision streams number their blocks with 16 bits, 1 to 65535 and round again without 0, or (extended ids, and USB3 Vision) with 64
/// bits. Which of the two it is shows by the first id above 65535. Ids come in order, but for frames that are sent again,
/// which are behind by less than half of a round.
#[derive(Clone, Debug)]
pub(super) struct Ids {
    first: u64,
    wraps: bool,
    /// Number of the newest frame.
    newest: u64,
}

/// Ids of 16 bits without 0.
const ROUND: u64 = 65_535;

impl Ids {
    /// Of acquisitions that begin with the id `first`; ids of 16 bits are possible where the network is `gige`.
    pub(super) const fn new(first: u64, gige: bool) -> Self {
        Self {
            first,
            wraps: gige && first <= ROUND,
            newest: 0,
        }
    }

    /// An acquisition begins, with the id `first`.
    pub(super) const fn restart(&mut self, first: u64) {
        self.first = first;
        self.newest = 0;
    }

    /// The id behind `id`.
    pub(super) const fn after(&self, id: u64) -> u64 {
        if self.wraps && id == ROUND { 1 } else { id + 1 }
    }

    /// The id `frames` before `id`.
    pub(super) const fn before(&self, id: u64, frames: u64) -> u64 {
        if self.wraps {
            (id + ROUND - 1 - frames % ROUND) % ROUND + 1
        } else {
            id.saturating_sub(frames)
        }
    }

    /// The number of the frame with this `id`, 0 for the first of the acquisition; `None` for one of before.
    pub(super) fn number_of(&mut self, id: u64) -> Option<u64> {
        if id > ROUND {
            self.wraps = false;
        }
        let number = if self.wraps {
            // Less than half of a round from the newest one, on either side.
            let newest_id = (self.first - 1 + self.newest) % ROUND + 1;
            let ahead = (id + ROUND - newest_id) % ROUND;
            if ahead <= ROUND / 2 {
                Some(self.newest + ahead)
            } else {
                self.newest.checked_sub(ROUND - ahead)
            }
        } else {
            id.checked_sub(self.first)
        };
        self.newest = self.newest.max(number.unwrap_or(0));
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_of_16_bits_go_round_without_zero_and_those_of_64_go_on() {
        for first in [1, 2, 65_401, 65_535] {
            let mut ids = Ids::new(first, true);
            for acquisition in 0..2 {
                ids.restart(first);
                // Every 1000th is lost, and one comes late.
                for number in (0..200_000_u64).filter(|number| number % 1000 != 7) {
                    let id = (first - 1 + number) % ROUND + 1;
                    assert_eq!(ids.number_of(id), Some(number), "{first} {acquisition}");
                    if number % 1000 == 9 {
                        let late = (first - 1 + number - 2) % ROUND + 1;
                        assert_eq!(ids.number_of(late), Some(number - 2), "{first}");
                    }
                }
            }
        }
        let ids = Ids::new(65_534, true);
        assert_eq!([1, 65_535].map(|id| ids.before(id, 2)), [65_534, 65_533]);
        assert_eq!([65_534, 65_535].map(|id| ids.after(id)), [65_535, 1]);
        let mut ids = Ids::new(1, true);
        for number in (0..200_000_u64).step_by(20_000) {
            assert_eq!(ids.number_of(1 + number), Some(number));
        }
        let mut usb = Ids::new(0, false);
        assert_eq!(
            [0, 1, 70_000].map(|id| usb.number_of(id)),
            [Some(0), Some(1), Some(70_000)]
        );
        // What was on its way before the acquisition began is none of its frames.
        let mut late = Ids::new(5, true);
        assert_eq!([5, 4, 6].map(|id| late.number_of(id)), [Some(0), None, Some(1)]);
        let mut late = Ids::new(70_000, true);
        assert_eq!([69_999, 70_002].map(|id| late.number_of(id)), [None, Some(2)]);
    }
}
