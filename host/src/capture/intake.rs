//! Taking the frames of a camera in while something else keeps the program busy.
//!
//! # Design
//! The camera gets a thread of its own for the length of a run: a request to the trigger box that has to be repeated, or a process that gets
//! no time, must not leave frames in the few buffers that a driver has. What comes goes through a [ring](super::ring); where the
//! run's frames are collected, they are taken out with each event of the box. At the run's end the camera comes back to
//! who lent it, with nothing left behind.
//!
//! A simulated camera computes its frames on rayon's pool. Where a run is itself a task of that pool, as in studies, there is no such thread: its
//! worker would wait for a thread that waits for a worker.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, Scope, ScopedJoinHandle, park_timeout};
use std::time::{Duration, Instant};

use super::CaptureError;
use super::camera::{Camera, CameraError, Frame};
use super::follow::Ending;
use super::ring::{Outlet, frames_in_ring, ring};

/// A camera is asked for this long at a time: so late it comes back at most.
const POLL: Duration = Duration::from_millis(5);
/// A camera that does not wait, such as a simulated one, is asked again so much later.
const IDLE: Duration = Duration::from_millis(1);

/// Frames are taken in for this long at a time where there is no thread for them: the trigger box has to be heard.
const AT_ONCE: Duration = Duration::from_millis(100);

/// Follows a run by `play`, which calls what it is given with each word of the trigger box: the frames that have come until then are
/// added to `frames`.
pub(super) fn taking_in(
    camera: &mut dyn Camera,
    frames: &mut Vec<Frame>,
    play: impl FnOnce(&mut dyn FnMut() -> Result<(), CaptureError>) -> Result<Ending, CaptureError>,
) -> Result<Ending, CaptureError> {
    if rayon::current_thread_index().is_some() {
        return play(&mut || {
            let began = Instant::now();
            while began.elapsed() < AT_ONCE
                && let Some(frame) = camera.next_frame(Duration::ZERO)?
            {
                frames.push(frame);
            }
            Ok(())
        });
    }
    thread::scope(|scope| {
        let intake = Intake::begin(scope, camera);
        let ending = play(&mut || Ok(intake.take(frames)?))?;
        intake.end(frames)?;
        Ok(ending)
    })
}

/// The thread that takes frames in. Dropped, it ends.
struct Intake<'scope> {
    frames: Outlet<Result<Frame, CameraError>>,
    over: Arc<AtomicBool>,
    thread: ScopedJoinHandle<'scope, ()>,
}

impl<'scope> Intake<'scope> {
    /// Begins to take in the frames of `camera`, which is armed.
    fn begin<'env>(scope: &'scope Scope<'scope, 'env>, camera: &'env mut dyn Camera) -> Self {
        let (inlet, frames) = ring(frames_in_ring(camera.format().len() * size_of::<u16>()));
        let over = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&over);
        let thread = scope.spawn(move || {
            while !is_over.load(Ordering::Acquire) {
                let began = Instant::now();
                let (next, is_last) = match camera.next_frame(POLL) {
                    Ok(Some(frame)) => (Ok(frame), false),
                    Ok(None) => {
                        if began.elapsed() < POLL {
                            park_timeout(IDLE);
                        }
                        continue;
                    }
                    Err(error) => (Err(error), true),
                };
                if inlet.push(next).is_err() || is_last {
                    break;
                }
            }
        });
        Self { frames, over, thread }
    }

    /// Adds the frames that have come to `frames`.
    ///
    /// # Errors
    /// What the camera said instead of a frame.
    fn take(&self, frames: &mut Vec<Frame>) -> Result<(), CameraError> {
        // No more than fit at a time: a camera that sends without an end must not keep the box from being heard.
        for _ in 0..self.frames.capacity() {
            match self.frames.try_pop() {
                Ok(Some(frame)) => frames.push(frame?),
                Ok(None) | Err(_) => break,
            }
        }
        Ok(())
    }

    /// Gives the camera back, and adds what had come until then to `frames`.
    ///
    /// # Errors
    /// What the camera said instead of a frame.
    fn end(self, frames: &mut Vec<Frame>) -> Result<(), CameraError> {
        self.stop();
        let mut ended = Ok(());
        // Until the thread is gone: it may wait for room, too.
        for next in self.frames.rest() {
            match next {
                Ok(frame) => frames.push(frame),
                Err(error) => ended = Err(error),
            }
        }
        let (high_water, capacity) = (self.frames.high_water(), self.frames.capacity());
        tracing::debug!(
            high_water,
            capacity,
            waits = self.frames.waits(),
            "frames waited in the ring"
        );
        ended
    }

    fn stop(&self) {
        self.over.store(true, Ordering::Release);
        self.thread.thread().unpark();
    }
}

impl Drop for Intake<'_> {
    fn drop(&mut self) {
        self.stop();
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

    use rcg_protocol::State;

    use std::sync::Mutex;

    use super::*;
    use crate::instrument::frame_format::FrameFormat;

    /// A camera with few buffers, which sends a frame each time that it is asked, and may end with a failure.
    struct Busy {
        frames: u64,
        fails: bool,
        size_px: usize,
    }

    impl Camera for Busy {
        fn name(&self) -> &'static str {
            "busy"
        }

        fn format(&self) -> FrameFormat {
            FrameFormat {
                width_px: self.size_px,
                height_px: self.size_px,
                channels: 1,
                bits: 16,
            }
        }

        fn arm(&mut self) -> Result<(), CameraError> {
            Ok(())
        }

        fn next_frame(&mut self, _timeout: Duration) -> Result<Option<Frame>, CameraError> {
            if self.frames == 0 {
                let camera = "busy".to_owned();
                return if self.fails {
                    Err(CameraError::Disconnected { camera })
                } else {
                    Ok(None)
                };
            }
            self.frames -= 1;
            Ok(Some(Frame {
                id: self.frames,
                timestamp_s: 0.0,
                dn: Vec::new(),
            }))
        }
    }

    #[test]
    fn frames_wait_in_the_ring_while_nobody_asks_and_all_are_there_at_the_end() {
        // The ring holds 8 frames of this size; the others wait in the camera.
        let mut camera = Busy {
            frames: 50,
            fails: false,
            size_px: 4096,
        };
        let mut frames = Vec::new();
        thread::scope(|scope| {
            let intake = Intake::begin(scope, &mut camera);
            while intake.frames.waits() == 0 {
                thread::yield_now();
            }
            assert_eq!(intake.frames.high_water(), 8);
            intake.take(&mut frames).unwrap();
            assert_eq!(frames.len(), 8);
            intake.end(&mut frames).unwrap();
        });
        // What the thread had not asked for is left to who got the camera back.
        let left = camera.frames;
        let ids: Vec<u64> = frames.iter().map(|frame| frame.id).collect();
        assert_eq!(ids, (left..50).rev().collect::<Vec<_>>());
        // The one that waited for room came in.
        assert!(frames.len() > 8, "{}", frames.len());
    }

    #[test]
    fn what_the_camera_says_instead_of_a_frame_is_told_behind_its_frames() {
        for asked in [true, false] {
            let mut camera = Busy {
                frames: 3,
                fails: true,
                size_px: 8,
            };
            let mut frames = Vec::new();
            let said = thread::scope(|scope| {
                let intake = Intake::begin(scope, &mut camera);
                let began = Instant::now();
                while asked && began.elapsed() < Duration::from_mins(1) {
                    intake.take(&mut frames)?;
                }
                while !intake.thread.is_finished() {
                    thread::yield_now();
                }
                intake.end(&mut frames)
            });
            assert!(said.unwrap_err().to_string().contains("the connection has ended"));
            assert_eq!(frames.len(), 3);
        }
    }

    #[test]
    fn a_worker_of_the_pool_waits_for_no_thread_that_may_need_the_pool() {
        // On whose thread it was asked.
        struct Asked(Arc<Mutex<Vec<thread::ThreadId>>>);

        impl Camera for Asked {
            fn name(&self) -> &'static str {
                "asked"
            }

            fn format(&self) -> FrameFormat {
                FrameFormat {
                    width_px: 1,
                    height_px: 1,
                    channels: 1,
                    bits: 16,
                }
            }

            fn arm(&mut self) -> Result<(), CameraError> {
                Ok(())
            }

            fn next_frame(&mut self, _timeout: Duration) -> Result<Option<Frame>, CameraError> {
                self.0.lock().unwrap().push(thread::current().id());
                Ok(None)
            }
        }

        let followed = || {
            let asked = Arc::default();
            let mut camera = Asked(Arc::clone(&asked));
            let ending = Ending {
                state: State::Done,
                steps_done: 0,
                fault: None,
                at: None,
            };
            taking_in(&mut camera, &mut Vec::new(), |take_in| {
                while asked.lock().unwrap().is_empty() {
                    take_in()?;
                    thread::sleep(Duration::from_millis(1));
                }
                Ok(ending)
            })
            .unwrap();
            let here = thread::current().id();
            asked.lock().unwrap().iter().all(|asked| *asked == here)
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert!(pool.install(followed));
        assert!(!followed());
    }

    #[test]
    fn who_unwinds_out_of_a_run_is_not_held_back() {
        let mut camera = Busy {
            frames: u64::MAX,
            fails: false,
            size_px: 4096,
        };
        let ended = catch_unwind(AssertUnwindSafe(|| {
            thread::scope(|scope| {
                let _intake = Intake::begin(scope, &mut camera);
                resume_unwind(Box::new("stopped"));
            });
        }));
        assert!(ended.is_err());
    }
}
