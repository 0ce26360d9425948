//! A bounded ring between the thread that takes frames in and the one that keeps them.
//!
//! # Design
//! The ring holds so many items and no more: memory does not grow with what passes through. Who puts something in waits where there is no
//! room, so nothing is lost in it; it says how full it ever was and how often somebody had to wait, which tells whether the size is right.
//! A ring for frames holds about [`RING_BYTES`] of them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::time::Duration;

/// Bytes of frames that a ring holds: 0.7 s of 96×96 pixels of one byte at 9,523 frames a second, longer than the disk or a request to the
/// trigger box is silent.
pub const RING_BYTES: usize = 64 << 20;
/// Frames that a ring holds at least and at most, however large or small they are.
const FRAMES: std::ops::RangeInclusive<usize> = 8..=8192;

/// How many frames of so many bytes a ring holds.
#[must_use]
pub const fn frames_in_ring(frame_bytes: usize) -> usize {
    let frames = RING_BYTES / if frame_bytes == 0 { 1 } else { frame_bytes };
    if frames < *FRAMES.start() {
        *FRAMES.start()
    } else if frames > *FRAMES.end() {
        *FRAMES.end()
    } else {
        frames
    }
}

/// What a ring has seen.
#[derive(Debug, Default)]
struct Gauge {
    inside: AtomicUsize,
    high_water: AtomicUsize,
    waits: AtomicU64,
    /// Whether nobody takes anything out any more.
    is_left: AtomicBool,
}

/// Where items go in.
#[derive(Debug)]
pub struct Inlet<T> {
    items: SyncSender<T>,
    gauge: Arc<Gauge>,
}

/// Where items come out, in their order.
#[derive(Debug)]
pub struct Outlet<T> {
    items: Receiver<T>,
    gauge: Arc<Gauge>,
    capacity: usize,
}

/// The other side is gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gone;

/// A ring for `capacity` items, at least 1.
#[must_use]
pub fn ring<T>(capacity: usize) -> (Inlet<T>, Outlet<T>) {
    let capacity = capacity.max(1);
    let (inlet, outlet) = sync_channel(capacity);
    let gauge = Arc::new(Gauge::default());
    (
        Inlet {
            items: inlet,
            gauge: Arc::clone(&gauge),
        },
        Outlet {
            items: outlet,
            gauge,
            capacity,
        },
    )
}

impl<T> Inlet<T> {
    /// Puts `item` in, waiting for room.
    ///
    /// # Errors
    /// [`Gone`] if nobody takes anything out any more.
    pub fn push(&self, item: T) -> Result<(), Gone> {
        let sent = match self.items.try_send(item) {
            Ok(()) => Ok(()),
            Err(TrySendError::Full(item)) => {
                self.gauge.waits.fetch_add(1, Ordering::Relaxed);
                self.items.send(item).map_err(|_| Gone)
            }
            Err(TrySendError::Disconnected(_)) => Err(Gone),
        };
        sent?;
        // Counted behind: what has been taken out already counts as one less for a moment, never as one more than fit.
        let inside = self.gauge.inside.fetch_add(1, Ordering::AcqRel).wrapping_add(1);
        if inside.cast_signed() > 0 {
            self.gauge.high_water.fetch_max(inside, Ordering::Relaxed);
        }
        Ok(())
    }

    /// Whether nobody takes anything out any more, for who has nothing to put in.
    #[must_use]
    pub fn is_left(&self) -> bool {
        self.gauge.is_left.load(Ordering::Acquire)
    }
}

impl<T> Drop for Outlet<T> {
    fn drop(&mut self) {
        self.gauge.is_left.store(true, Ordering::Release);
    }
}

impl<T> Outlet<T> {
    /// The oldest item, if there is one.
    ///
    /// # Errors
    /// [`Gone`] if there is none, and nobody puts anything in any more.
    pub fn try_pop(&self) -> Result<Option<T>, Gone> {
        match self.items.try_recv() {
            Ok(item) => Ok(Some(self.taken(item))),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(Gone),
        }
    }

    /// The oldest item, waiting at most `timeout` for one.
    ///
    /// # Errors
    /// [`Gone`] if there is none, and nobody puts anything in any more.
    pub fn pop(&self, timeout: Duration) -> Result<Option<T>, Gone> {
        match self.items.recv_timeout(timeout) {
            Ok(item) => Ok(Some(self.taken(item))),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Gone),
        }
    }

    /// All items until nobody puts anything in any more.
    pub fn rest(&self) -> impl Iterator<Item = T> + '_ {
        self.items.iter().map(|item| self.taken(item))
    }

    fn taken(&self, item: T) -> T {
        self.gauge.inside.fetch_sub(1, Ordering::AcqRel);
        item
    }

    /// How many items fit.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.capacity
    }

    /// How many items were in at most.
    #[must_use]
    pub fn high_water(&self) -> usize {
        self.gauge.high_water.load(Ordering::Relaxed).min(self.capacity)
    }

    /// How often there was no room at first.
    #[must_use]
    pub fn waits(&self) -> u64 {
        self.gauge.waits.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    #[test]
    fn nothing_is_lost_or_turned_round_however_slow_either_side_is() {
        // One side dawdles at every 50th item, and the ring is smaller than what passes.
        for (capacity, slow_inlet) in [(1, false), (7, false), (7, true), (64, false)] {
            let (inlet, outlet) = ring(capacity);
            let dawdle = |item: u32, is_slow: bool| {
                if is_slow && item.is_multiple_of(50) {
                    thread::sleep(Duration::from_micros(200));
                }
            };
            thread::scope(|scope| {
                scope.spawn(move || {
                    for item in 0..2000 {
                        dawdle(item, slow_inlet);
                        inlet.push(item).unwrap();
                    }
                });
                for (expected, item) in (0..2000).zip(outlet.rest()) {
                    dawdle(item, !slow_inlet);
                    assert_eq!(item, expected, "{capacity}");
                }
                // Who puts in ends a moment later.
                assert_eq!(outlet.rest().next(), None);
                assert_eq!(outlet.try_pop(), Err(Gone));
            });
            assert!((1..=capacity).contains(&outlet.high_water()), "{capacity}");
        }
    }

    #[test]
    fn a_full_ring_holds_what_it_should_and_lets_who_puts_in_wait() {
        let (inlet, outlet) = ring(3);
        for item in 0..3 {
            inlet.push(item).unwrap();
        }
        assert_eq!((outlet.high_water(), outlet.waits()), (3, 0));
        thread::scope(|scope| {
            let waiting = scope.spawn(|| inlet.push(3));
            while outlet.waits() == 0 {
                thread::yield_now();
            }
            assert_eq!(outlet.pop(Duration::ZERO), Ok(Some(0)));
            waiting.join().unwrap().unwrap();
        });
        assert_eq!((outlet.high_water(), outlet.waits()), (3, 1));
        drop(inlet);
        assert_eq!(outlet.rest().collect::<Vec<_>>(), [1, 2, 3]);
    }

    #[test]
    fn who_puts_in_hears_that_nobody_takes_out() {
        let (inlet, outlet) = ring(1);
        inlet.push(0).unwrap();
        thread::scope(|scope| {
            let waiting = scope.spawn(|| inlet.push(1));
            drop(outlet);
            assert_eq!(waiting.join().unwrap(), Err(Gone));
        });
        assert_eq!(inlet.push(2), Err(Gone));
        assert!(inlet.is_left());
    }

    #[test]
    fn a_ring_holds_as_many_bytes_whatever_the_frames() {
        for (bytes, frames) in [(0, 8192), (96 * 96, 7281), (1 << 20, 64), (1 << 30, 8)] {
            assert_eq!(frames_in_ring(bytes), frames);
        }
    }
}
