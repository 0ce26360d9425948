//! The seam to projectors: patterns that are loaded first and then advanced by the trigger line, or shown when they are told to.

use crate::base::blame::Blame;
use crate::plan::pattern::BitPattern;
use crate::plan::schedule::Timing;
use crate::store::whole_file::FileError;

/// What a projector could not do.
#[derive(Debug, thiserror::Error)]
pub enum ProjectorError {
    /// The pattern is not of the projector's native resolution.
    #[error("projector {projector}: expected a pattern of {}×{} pixels, found {}×{}", native.0, native.1, found.0, found.1)]
    Resolution {
        /// The projector.
        projector: String,
        /// Its resolution, (width, height).
        native: (usize, usize),
        /// The pattern's.
        found: (usize, usize),
    },
    /// No more patterns fit.
    #[error("projector {projector}: expected at most {limit} patterns at a time, found more")]
    Full {
        /// The projector.
        projector: String,
        /// How many fit.
        limit: usize,
    },
    /// The patterns cannot be handed over.
    #[error("projector {projector}: {reason}")]
    Failed {
        /// The projector.
        projector: String,
        /// Why not.
        reason: String,
    },
    /// A file of the patterns.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Refuses a `pattern` that is not of the resolution `native` (width, height) of `projector`.
pub(crate) fn check_resolution(
    projector: &str,
    native: (usize, usize),
    pattern: &BitPattern,
) -> Result<(), ProjectorError> {
    if pattern.size_px() == native {
        return Ok(());
    }
    Err(ProjectorError::Resolution {
        projector: projector.to_owned(),
        native,
        found: pattern.size_px(),
    })
}

/// Refuses one more pattern than `limit` where so many are `loaded` in `projector`.
pub(crate) fn check_room(projector: &str, loaded: usize, limit: usize) -> Result<(), ProjectorError> {
    if loaded < limit {
        return Ok(());
    }
    Err(ProjectorError::Full {
        projector: projector.to_owned(),
        limit,
    })
}

impl Blame for ProjectorError {
    fn is_input(&self) -> bool {
        match self {
            Self::Resolution { .. } | Self::Full { .. } => true,
            Self::Failed { .. } => false,
            Self::File(error) => error.is_input(),
        }
    }
}

/// A projector that shows black until triggered, then one loaded pattern after the other, each from one
/// trigger to the next.
pub trait Projector: Send {
    /// What a person knows it by.
    fn name(&self) -> &str;

    /// What it says of itself, in one line.
    fn description(&self) -> String {
        self.name().to_owned()
    }

    /// Resolution in pixels (width, height).
    fn size_px(&self) -> (usize, usize);

    /// How many patterns can be loaded at a time.
    fn capacity(&self) -> usize;

    /// Forgets all patterns and shows black.
    ///
    /// # Errors
    /// [`ProjectorError`].
    fn clear(&mut self) -> Result<(), ProjectorError>;

    /// Loads one more pattern behind those that are loaded.
    ///
    /// # Errors
    /// [`ProjectorError`].
    fn load(&mut self, pattern: &BitPattern) -> Result<(), ProjectorError>;

    /// The steps in which the patterns that are loaded will be shown, one after the other; a pattern stays in steps without a PROJ pulse.
    ///
    /// # Errors
    /// [`ProjectorError`] where it cannot show them so.
    fn pace(&mut self, _steps: &[Timing]) -> Result<(), ProjectorError> {
        Ok(())
    }

    /// All patterns are loaded; returns when the next trigger can show the first of them.
    ///
    /// # Errors
    /// [`ProjectorError`].
    fn ready(&mut self) -> Result<(), ProjectorError> {
        Ok(())
    }

    /// What shows the loaded patterns where no trigger advances them.
    fn leading(&mut self) -> Option<&mut dyn Leading> {
        None
    }
}

/// A projector that no trigger advances: it is told what to show, and a photodiode at SYNC tells the trigger box that it does. Each
/// picture makes one edge of SYNC, as it appears.
pub trait Leading: Send {
    /// Length of a display frame, s.
    fn frame_s(&self) -> f64;

    /// Shows the loaded pattern `number`, from 0 on, until another is shown. Returns when it appeared, s on the display's own clock.
    ///
    /// # Errors
    /// [`ProjectorError`].
    fn show(&mut self, number: usize) -> Result<f64, ProjectorError>;

    /// The run is over.
    ///
    /// # Errors
    /// [`ProjectorError`] where what was shown last was not to be seen all the time.
    fn finish(&mut self) -> Result<(), ProjectorError>;
}
