//! Which mirrors a DLPC900 drives, and what these can show.

/// Shortest exposure of a pattern of eight bits, µs: 247 patterns a second.
pub const SHORTEST_GREY_US: u32 = 4046;
/// How many images of 24 planes a unit stores.
pub const IMAGES: usize = 18;
/// Versions of the firmware whose commands this driver knows, the first number of each: those of the programmer's guide DLPU018
/// from 2016 on.
pub const FIRMWARE: std::ops::RangeInclusive<u8> = 3..=6;

/// A digital micromirror device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Model {
    /// Its name.
    pub name: &'static str,
    /// Mirrors, (columns, rows).
    pub size_px: (usize, usize),
    /// Whether two controllers share it, the right half to the secondary one.
    pub is_dual: bool,
    /// How many patterns a sequence has at most (DLPU018J, 2.4.4.3.5, and what [`IMAGES`] hold).
    pub entries: usize,
}

/// In the order of their codes in the answer to command 0206, from 1 on (DLPU018J, 2.1.5).
const MODELS: [Model; 5] = [
    Model::new("DLP6500", (1920, 1080), false, 400),
    Model::new("DLP9000", (2560, 1600), true, 400),
    Model::new("DLP670S", (2716, 1600), true, 400),
    Model::new("DLP500YX", (2048, 1200), true, 400),
    Model::new("DLP5500", (1024, 768), false, 432),
];

impl Model {
    const fn new(name: &'static str, size_px: (usize, usize), is_dual: bool, entries: usize) -> Self {
        Self {
            name,
            size_px,
            is_dual,
            entries,
        }
    }

    /// The one of this `code` in the answer to command 0206.
    #[must_use]
    pub fn of(code: u8) -> Option<Self> {
        MODELS.get(usize::from(code).checked_sub(1)?).copied()
    }

    /// Columns (from, until) of the parts of an image, in the order primary, secondary controller.
    #[must_use]
    pub fn halves(&self) -> Vec<(usize, usize)> {
        let width = self.size_px.0;
        if self.is_dual {
            vec![(0, width / 2), (width / 2, width)]
        } else {
            vec![(0, width)]
        }
    }
}
