//! Whether SYNC edges come as regularly as a projector's vsync should.
//!
//! # Design
//! Nobody tells the box the projector's period, so it learns it: two intervals in a row that agree within a
//! quarter are taken for it, and it follows slow drift. From then on an edge after less than half a period is
//! one too many, and one after more than one and a half means that at least one was missed. An edge too many
//! does not move the count. When `RELEARN_AFTER` intervals in a row are irregular the source has another
//! period now, and learning begins again.
//!
//! # Tradeoffs
//! What happens before the period is known, which takes three edges, is not judged. Nothing is claimed that
//! was not seen twice.

use rcg_protocol::Ticks;

/// Irregular intervals in a row after which the period is given up: more than mishaps bring.
const RELEARN_AFTER: u8 = 3;

/// What an edge is, compared with those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Regularity {
    /// As expected, or there is no expectation yet.
    Regular,
    /// At least one edge before it did not come.
    AfterMissing,
    /// It came in between.
    Extra,
}

/// Judges the edges of one run.
#[derive(Clone, Copy, Debug, Default)]
pub struct VsyncWatch {
    last: Option<Ticks>,
    /// The last interval, while the period is not known.
    candidate: Option<Ticks>,
    period: Option<Ticks>,
    irregular: u8,
}

impl VsyncWatch {
    /// No edge seen.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            last: None,
            candidate: None,
            period: None,
            irregular: 0,
        }
    }

    /// An edge at `at`; times do not decrease.
    pub fn edge(&mut self, at: Ticks) -> Regularity {
        let Some(last) = self.last else {
            self.last = Some(at);
            return Regularity::Regular;
        };
        let interval = at.saturating_sub(last);
        let Some(period) = self.period else {
            self.last = Some(at);
            if self.candidate.is_some_and(|before| agree(before, interval)) {
                self.period = Some(interval);
            }
            self.candidate = Some(interval);
            return Regularity::Regular;
        };
        let regularity = if 2 * interval.0 < period.0 {
            Regularity::Extra
        } else {
            self.last = Some(at);
            if 2 * interval.0 > 3 * period.0 {
                Regularity::AfterMissing
            } else {
                self.period = Some(interval);
                self.irregular = 0;
                return Regularity::Regular;
            }
        };
        self.irregular += 1;
        if self.irregular == RELEARN_AFTER {
            *self = Self {
                last: Some(at),
                ..Self::new()
            };
        }
        regularity
    }
}

/// Whether two intervals differ by less than a quarter.
const fn agree(a: Ticks, b: Ticks) -> bool {
    4 * a.0.abs_diff(b.0) < b.0
}

#[cfg(test)]
mod tests {
    use super::Regularity::{AfterMissing, Extra, Regular};
    use super::*;

    fn judge(edges: impl IntoIterator<Item = u64>) -> std::vec::Vec<Regularity> {
        let mut watch = VsyncWatch::new();
        edges.into_iter().map(|at| watch.edge(Ticks(at))).collect()
    }

    #[test]
    fn a_steady_source_with_jitter_and_drift_is_regular() {
        let edges = (0..1000_u64).map(|k| 1000 * k + k * k / 50 + (k * 7919) % 200);
        assert!(judge(edges).iter().all(|&edge| edge == Regular));
    }

    #[test]
    fn a_missing_edge_is_told_by_the_one_after_it() {
        let edges = (0..20_u64).filter(|k| ![5, 11, 12].contains(k));
        let told: std::vec::Vec<u64> = edges
            .clone()
            .zip(judge(edges.map(|k| 1000 * k)))
            .filter_map(|(k, edge)| (edge == AfterMissing).then_some(k))
            .collect();
        assert_eq!(told, [6, 13]);
    }

    #[test]
    fn an_edge_too_many_does_not_move_the_count() {
        let edges = [0, 1000, 2000, 3000, 3250, 4000, 4100, 4200, 5000, 6000];
        let mut expected = [Regular; 10];
        for extra in [4, 6, 7] {
            expected[extra] = Extra;
        }
        assert_eq!(judge(edges), expected);
    }

    #[test]
    fn another_period_is_learned() {
        let slow = (0..5).map(|k| 1000 * k);
        let slower = (0..10).map(|k| 4000 + 3000 * (k + 1));
        let judged = judge(slow.chain(slower));
        assert_eq!(judged[5..8], [AfterMissing; 3]);
        assert!(judged[8..].iter().all(|&edge| edge == Regular));
    }

    #[test]
    fn nothing_is_said_before_the_period_is_known() {
        assert_eq!(judge([0, 250, 1000, 2000, 3000]), [Regular; 5]);
        assert_eq!(judge([0, 2000, 3000, 4000]), [Regular; 4]);
    }
}
