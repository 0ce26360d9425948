//! Whether the channels of two results stand for the same light.

use super::{BANDS, Brdf, BrdfError};

impl Brdf {
    /// Refuses an `other` file whose channels are of other wavelengths than those of this, as far as both say. Names may differ.
    ///
    /// # Errors
    /// [`BrdfError::Content`] with what both say.
    pub(crate) fn check_same_bands(&self, other: &Self) -> Result<(), BrdfError> {
        match (self.bands(), other.bands()) {
            (Some(own), Some(others)) if !own.is_same_light(&others) => Err(self.other_bands(other)),
            _ => Ok(()),
        }
    }

    /// Refuses an `other` file whose channels are nowhere near those of this, as far as both say: each band has to reach the centre of the
    /// one that it is compared with. A file of one channel is compared with the mean of the channels of this, and has to reach all.
    ///
    /// # Errors
    /// [`BrdfError::Content`] with what both say.
    pub(crate) fn check_near_bands(&self, other: &Self) -> Result<(), BrdfError> {
        match (self.bands(), other.bands()) {
            (Some(own), Some(others)) if !others.is_near(&own) => Err(self.other_bands(other)),
            _ => Ok(()),
        }
    }

    /// What people call the channels, in their order: the bands, with centre and width, as far as the file says; else red, green and blue, and
    /// nothing ("") where there is only one.
    #[must_use]
    pub fn channel_labels(&self) -> Vec<String> {
        let usual = || match self.channels() {
            1 => vec![String::new()],
            channels => ["red", "green", "blue"]
                .into_iter()
                .take(channels)
                .map(str::to_owned)
                .collect(),
        };
        self.bands().map_or_else(usual, |bands| bands.labels())
    }

    fn other_bands(&self, other: &Self) -> BrdfError {
        let words = |brdf: &Self| brdf.bands().map_or_else(String::new, |bands| bands.words());
        BrdfError::Content {
            path: other.path().display().to_string(),
            field: BANDS,
            expected: format!("{} as in {}", words(self), self.path().display()),
            found: words(other),
        }
    }
}
