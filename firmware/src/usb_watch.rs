//! Whether USB still gets on.
//!
//! # Design
//! A host that is there begins a frame every millisecond, and the controller counts them. One that counts no frame, and says
//! neither that the bus sleeps nor that it was cut off, is stuck: after some errors on the bus it never comes back by itself
//! (errata RP2040-E5 and E15). So is one whose packets nobody takes although the host goes on sending requests. A host that
//! sleeps or does not read is none of these.

use rcg_protocol::Ticks;

/// Packets in a row that nobody took in time, each with a request before it, until USB is taken for stuck.
const UNTAKEN: u8 = 5;

/// What was seen of USB.
#[derive(Debug)]
pub struct UsbWatch {
    frame: u16,
    /// Since when it is that frame.
    since: Ticks,
    untaken: u8,
}

impl Default for UsbWatch {
    fn default() -> Self {
        Self::new()
    }
}

impl UsbWatch {
    /// Nothing seen.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            frame: 0,
            since: Ticks::ZERO,
            untaken: 0,
        }
    }

    /// The host has taken a packet, or nobody did although the host had sent something since the last time.
    pub fn packet(&mut self, taken: bool) {
        self.untaken = if taken { 0 } else { self.untaken.saturating_add(1) };
    }

    /// Whether USB is stuck at `now`: for longer than `limit` no other `frame` came while the host was `awake`.
    pub fn is_stuck(&mut self, now: Ticks, awake: bool, frame: u16, limit: Ticks) -> bool {
        if !awake {
            self.untaken = 0;
        }
        if !awake || frame != self.frame {
            (self.frame, self.since) = (frame, now);
        }
        now.saturating_sub(self.since) > limit || self.untaken >= UNTAKEN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Ticks = Ticks(500);

    #[test]
    fn frames_that_cease_are_noticed_and_a_bus_that_sleeps_is_not() {
        let mut watch = UsbWatch::new();
        for now in 0..3000 {
            assert!(!watch.is_stuck(Ticks(now), true, (now % 2048) as u16, LIMIT));
        }
        for now in 3000..9000 {
            assert!(!watch.is_stuck(Ticks(now), false, 7, LIMIT), "it sleeps");
        }
        let noticed = (9000..9999).find(|&now| watch.is_stuck(Ticks(now), true, 7, LIMIT));
        assert_eq!(noticed, Some(9000 + LIMIT.0));
        assert!(!watch.is_stuck(Ticks(9600), true, 8, LIMIT), "it goes on");
    }

    #[test]
    fn packets_that_nobody_takes_are_noticed_where_requests_come() {
        let mut watch = UsbWatch::new();
        let stuck = |watch: &mut UsbWatch, now: u64| watch.is_stuck(Ticks(now), true, now as u16, LIMIT);
        for now in 0..100 {
            // A host that reads now and then.
            watch.packet(now % 4 == 0);
            assert!(!stuck(&mut watch, now));
        }
        let noticed = (100..999).find(|&now| {
            watch.packet(false);
            stuck(&mut watch, now)
        });
        assert_eq!(noticed, Some(101));
    }
}
