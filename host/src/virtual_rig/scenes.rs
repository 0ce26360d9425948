//! Scenes that were shown before: what stands in the holder again as it did is not computed again.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::held::Held;
use super::scene::Scene;
use super::truth::Truth;

/// As many as a standard has tilts, and one more.
const MOST: usize = 5;

/// The last ones.
#[derive(Clone, Debug, Default)]
pub(super) struct Scenes(Arc<Mutex<VecDeque<Shown>>>);

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
        // Of a mirror no two views are alike.
        if matches!(held, Held::Mirror(_)) {
            return Arc::new(Scene::new(truth, held));
        }
        let mut scenes = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_this = |shown: &&Shown| shown.truth == *truth && shown.scene.is_of(&held);
        if let Some(shown) = scenes.iter().find(is_this) {
            return shown.scene.clone();
        }
        let scene = Arc::new(Scene::new(truth, held));
        scenes.truncate(MOST - 1);
        scenes.push_front(Shown {
            truth: truth.clone(),
            scene: scene.clone(),
        });
        scene
    }
}
