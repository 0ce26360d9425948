//! Which SYNC edges began steps.
//!
//! # Design
//! The state machine that makes the pulses waits for an edge by itself ([`crate::pulse`]): from the moment at which it
//! is *ready* it looks for the line at rest, does not look for [`SYNC_MASK`] ticks, looks whether it is at rest still, and
//! starts over if not; then the next edge begins the step. It tells that it begins one, and of that the microsecond is
//! kept. Another machine stamps the edges, each up to one tick late, and does not know what they do.
//!
//! So for most edges the stamps alone say what they did, and what the machine tells has to agree. Where an edge came within
//! a tick or two of the border the machine decides. Where both contradict each other, or another edge came in the same
//! microseconds, it is not certain what happened, and that is an error: a record never rests on a guess.
//!
//! An edge so short after the line went to rest is a bounce, whatever the machine does: it cannot begin a step, and is no
//! pulse of the projector.
//!
//! # Tradeoffs
//! A glitch of less than four ticks may have no stamp, and may begin a step. If an edge with a stamp follows within twice the
//! microseconds that the machine's word is uncertain by, the step is told with that one.

use rcg_protocol::Ticks;

use crate::pulse::SYNC_MASK;

/// From the first tick in which the machine looks for the line at rest to the first one that ends its wait.
const FROM_REST: Ticks = Ticks(SYNC_MASK + 1);

/// By how much a time of this run may be too late.
const LATE: Ticks = Ticks(1);

/// The machine told of a step that no edge can have begun, or of none although an edge must have, or it is not certain
/// which of two edges it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unclear;

/// What a SYNC edge is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyncEdge {
    /// It came too shortly after the one before to be one.
    Bounce,
    /// It began nothing.
    Idle,
    /// It began the next step.
    Begins,
}

/// Follows the wait of the machine from edge to edge.
#[derive(Debug)]
pub struct Starts {
    /// When the machine is ready for the next edge, at the latest; a tick before that at the earliest.
    ready: Ticks,
    /// Since when the line is at rest, if it is.
    rests_since: Option<Ticks>,
    /// The first tick at rest that the machine may have seen in this wait …
    earliest: Option<Ticks>,
    /// … and the last that it can have been, once it has seen one for certain.
    latest: Option<Ticks>,
    /// Steps whose edge is known.
    known: u32,
    /// Since when the machine has told of more.
    ahead_since: Option<Ticks>,
    /// By how much the machine's word may be off.
    coarse: Ticks,
}

impl Starts {
    /// A machine that is ready at `ready`, and a line that is `active` when the run starts. When the machine began a step is
    /// known to `coarse`.
    #[must_use]
    pub const fn new(ready: Ticks, active: bool, coarse: Ticks) -> Self {
        Self {
            ready,
            rests_since: if active { None } else { Some(Ticks::ZERO) },
            earliest: None,
            latest: None,
            known: 0,
            ahead_since: None,
            coarse,
        }
    }

    /// Steps whose edge is known.
    #[must_use]
    pub const fn known(&self) -> u32 {
        self.known
    }

    /// The machine waits for its next edge from `ready` on, at the latest, and at the earliest a tick before.
    pub fn wait_from(&mut self, ready: Ticks) {
        self.ready = ready;
        self.earliest = None;
        self.latest = None;
    }

    /// SYNC went to rest at `at`.
    pub fn rests(&mut self, at: Ticks) {
        self.rests_since = Some(at);
    }

    /// SYNC became active at `at`. `begun(n)` says about when the machine began step n of the run, if it has by now, and is
    /// asked once what it did up to now has been told. `next` is the next such edge, if it has come by then.
    ///
    /// # Errors
    /// [`Unclear`].
    pub fn edge(
        &mut self,
        at: Ticks,
        begun: impl FnOnce(u32) -> Option<Ticks>,
        next: impl FnOnce() -> Option<Ticks>,
    ) -> Result<SyncEdge, Unclear> {
        let Some(rests_since) = self.rests_since.take() else {
            return Ok(SyncEdge::Bounce); // half of a pulse was too short to be seen
        };
        let bounce = at.saturating_sub(rests_since) < FROM_REST;
        let begins = match self.foretell(rests_since, at) {
            Some(false) => false,
            foretold => {
                let then = begun(self.known).filter(|then| self.is_near(*then, at));
                match (foretold, then) {
                    (Some(_), then) => then.map(|_| true).ok_or(Unclear)?,
                    (None, None) => false,
                    (None, Some(then)) if next().is_some_and(|next| self.is_near(then, next)) => {
                        return Err(Unclear);
                    }
                    (None, Some(_)) => true,
                }
            }
        };
        self.known += u32::from(begins);
        Ok(match (begins, bounce) {
            (true, _) => SyncEdge::Begins,
            (false, true) => SyncEdge::Bounce,
            (false, false) => SyncEdge::Idle,
        })
    }

    /// Whether the machine may have meant the edge at `at` when it told of a step at `then`.
    fn is_near(&self, then: Ticks, at: Ticks) -> bool {
        then.0.abs_diff(at.0) <= self.coarse.0
    }

    /// SYNC became active at `at`, while no step waits.
    pub fn idle_edge(&mut self, at: Ticks) -> SyncEdge {
        match self.rests_since.take() {
            Some(rests_since) if at.saturating_sub(rests_since) >= FROM_REST => SyncEdge::Idle,
            _ => SyncEdge::Bounce,
        }
    }

    /// Whether an edge at `at` begins a step, after the line was at rest since `rests_since`; `None` if the times do not say.
    fn foretell(&mut self, rests_since: Ticks, at: Ticks) -> Option<bool> {
        // The first and the last tick in which each of it can have been.
        let since = [rests_since.saturating_sub(LATE), rests_since];
        let until = [at.saturating_sub(Ticks(2)), at.saturating_sub(LATE)];
        let look = [self.ready.saturating_sub(LATE), self.ready];
        // What it has seen of the line at rest before lies so far back that the line was active when it looked again.
        if self.latest.is_some_and(|seen| seen + Ticks(SYNC_MASK) < since[0]) {
            (self.earliest, self.latest) = (None, None);
        }
        let again = self
            .earliest
            .is_some_and(|seen| seen + Ticks(SYNC_MASK) < since[1]);
        if again {
            self.latest = None;
        }
        let first = [look[0].max(since[0]), look[1].max(since[1])];
        if self.earliest.is_none() && first[0] <= until[1] {
            self.earliest = Some(first[0]);
        }
        if self.latest.is_none() && first[1] <= until[0] {
            self.latest = Some(first[1]);
        }
        let surely = self
            .latest
            .is_some_and(|seen| seen + FROM_REST <= at.saturating_sub(LATE));
        let perhaps = self.earliest.is_some_and(|seen| seen + FROM_REST <= at);
        match (surely, perhaps) {
            (true, _) => Some(true),
            (false, false) => Some(false),
            (false, true) => None,
        }
    }

    /// Whether the machine may have `begun` a step whose edge is not known by `now`, all edges being told of up to that time but
    /// for those of the last `settling` ticks.
    ///
    /// # Errors
    /// [`Unclear`].
    pub fn agree(&mut self, begun: bool, now: Ticks, settling: Ticks) -> Result<(), Unclear> {
        if !begun {
            self.ahead_since = None;
            return Ok(());
        }
        let since = *self.ahead_since.get_or_insert(now);
        if now.saturating_sub(since) < settling {
            Ok(())
        } else {
            Err(Unclear)
        }
    }
}
