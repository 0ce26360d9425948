//! Scenes that were shown before: what stands in the holder again as it did is not computed again.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::held::Held;
use super::scene::{Scene, Shining};
use super::truth::Truth;

/// As many as a standard has tilts, and one more.
const MOST: usize = 5;

/// The last ones.
#[derive(Clone, Debug, Default)]
pub(super) struct Scenes(Arc<Mutex<Known>>);

/// What is known of earlier ones.
#[derive(Debug, Default)]
struct Known {
    shown: VecDeque<Shown>,
    /// What the projector's pixels shine, and by which truth: it is the same however the sample stands.
    shining: Option<(Truth, Arc<Shining>)>,
}

/// One of them.
struct Shown {
    truth: Truth,
    scene: Arc<Scene>,
}

impl std::fmt::Debug for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.truth.fmt(f)
    }
}

impl Scenes {
    /// What the rig that `truth` describes shows with `held` in it.
    pub(super) fn of(&self, truth: &Truth, held: Held) -> Arc<Scene> {
        let is_this = |shown: &&Shown| shown.truth == *truth && shown.scene.is_of(&held);
        if let Some(shown) = self.known().shown.iter().find(is_this) {
            return shown.scene.clone();
        }
        // Nobody waits while it is computed: who computes on several cores may come by here again.
        let shining = self.shining(truth);
        // Of a mirror no two views are alike.
        let is_kept = !matches!(held, Held::Mirror(_));
        let scene = Arc::new(Scene::of(truth, held, shining));
        if is_kept {
            let mut known = self.known();
            known.shown.truncate(MOST - 1);
            known.shown.push_front(Shown {
                truth: truth.clone(),
                scene: scene.clone(),
            });
        }
        scene
    }

    fn shining(&self, truth: &Truth) -> Arc<Shining> {
        let is_same =
            |other: &Truth| other.flaws == truth.flaws && other.rig.projector == truth.rig.projector;
        if let Some((_, shining)) = self.known().shining.as_ref().filter(|(of, _)| is_same(of)) {
            return shining.clone();
        }
        let shining = Arc::new(Shining::of(truth));
        self.known().shining = Some((truth.clone(), shining.clone()));
        shining
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
