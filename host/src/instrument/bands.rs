//! The bands of light that the channels of a result stand for.
//!
//! # Design
//! A camera with colours makes them by its filters, all in one frame. In front of a camera without colours the projector makes them: it
//! shows each pattern in red, green and blue, one after the other, and the frames are the channels of one image. What a band made by the
//! camera is called and where it lies changes nothing of what an image means, so that no calibration depends on it.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Primaries of a projector, in the order of its channels: red, green and blue.
pub const PRIMARIES: usize = 3;
/// Wavelengths that the centre of a band may have, nanometres: what mirrors, cameras and projectors of this kind work at.
pub const WAVELENGTHS_NM: std::ops::RangeInclusive<f64> = 200.0..=2500.0;
/// Widths that a band may have, nanometres: from a laser's line to white light and beyond.
pub const WIDTHS_NM: std::ops::RangeInclusive<f64> = 0.001..=2000.0;
/// What people see, nanometres (CIE 15: the colour-matching functions begin at 360 and end at 830; beyond these all are below 0.01 % of
/// their largest).
pub const VISIBLE_NM: std::ops::RangeInclusive<f64> = 380.0..=780.0;
/// Characters that a band's name may have.
pub const NAME_LENGTH: usize = 40;

/// What makes bands.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MadeBy {
    /// Filters of the camera: a frame has all bands.
    #[default]
    Camera,
    /// The projector's primaries, shown one after the other before a camera without colours: a frame has one band.
    Projector,
}

impl MadeBy {
    /// As rig files say it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Projector => "projector",
        }
    }
}

/// The bands of a rig, in the order of the channels of its results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bands {
    /// What makes them.
    #[serde(default)]
    pub made_by: MadeBy,
    /// What people call each of them.
    pub name: Vec<String>,
    /// Centre of each, nanometres: of the light that the camera sees in it.
    pub centre_nm: Vec<f64>,
    /// Full width of each at half of its maximum, nanometres.
    pub width_nm: Vec<f64>,
}

impl Bands {
    /// As files of results have them: an object of `made_by`, `name`, `centre_nm` and `width_nm`, the lists by channel.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!(self)
    }

    /// Those that a file of results with so many `channels` says in its `attribute`; `None` if it says none, or not as this program does.
    #[must_use]
    pub fn of_json(attribute: &Value, channels: usize) -> Option<Self> {
        let bands: Self = serde_json::from_value(attribute.clone()).ok()?;
        bands.flaw(channels).is_none().then_some(bands)
    }

    /// What is wrong with them as those of `channels` channels: the key, what is expected, and what is there.
    #[must_use]
    pub fn flaw(&self, channels: usize) -> Option<(&'static str, String, String)> {
        let each = [
            ("name", self.name.len()),
            ("centre_nm", self.centre_nm.len()),
            ("width_nm", self.width_nm.len()),
        ];
        if let Some((key, found)) = each.into_iter().find(|(_, length)| *length != channels) {
            let expected = format!("{channels}, one for each channel");
            return Some((key, expected, found.to_string()));
        }
        let is_name = |name: &str| {
            let is_long = name.chars().count() > NAME_LENGTH;
            !(name.trim().is_empty() || is_long || name.chars().any(char::is_control))
        };
        if let Some(name) = self.name.iter().find(|name| !is_name(name)) {
            let expected = format!("words of up to {NAME_LENGTH} characters");
            return Some(("name", expected, format!("\"{}\"", name.escape_default())));
        }
        let twice = |(at, name): &(usize, &String)| self.name[..*at].contains(name);
        if let Some((_, name)) = self.name.iter().enumerate().find(twice) {
            return Some((
                "name",
                "names that differ".to_owned(),
                format!("\"{name}\" twice"),
            ));
        }
        for (key, numbers, range) in [
            ("centre_nm", &self.centre_nm, WAVELENGTHS_NM),
            ("width_nm", &self.width_nm, WIDTHS_NM),
        ] {
            if let Some(found) = numbers.iter().find(|number| !range.contains(number)) {
                let expected = format!("numbers from {} to {} nanometres", range.start(), range.end());
                return Some((key, expected, found.to_string()));
            }
        }
        None
    }

    /// Whether they are of the same wavelengths as `others`, whatever they are called.
    #[must_use]
    pub fn is_same_light(&self, others: &Self) -> bool {
        let same =
            |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.total_cmp(b).is_eq());
        same(&self.centre_nm, &others.centre_nm) && same(&self.width_nm, &others.width_nm)
    }

    /// Whether each of them reaches the centre of the one of `others` in its place; a single one those of all.
    #[must_use]
    pub fn is_near(&self, others: &Self) -> bool {
        let reaches =
            |at: usize, centre_nm: f64| (self.centre_nm[at] - centre_nm).abs() <= 0.5 * self.width_nm[at];
        let mut centres = others.centre_nm.iter().enumerate();
        match self.centre_nm.len() {
            1 => centres.all(|(_, centre_nm)| reaches(0, *centre_nm)),
            own => own == others.centre_nm.len() && centres.all(|(at, centre_nm)| reaches(at, *centre_nm)),
        }
    }

    /// The first that nobody sees: with its centre beyond [`VISIBLE_NM`].
    #[must_use]
    pub fn invisible(&self) -> Option<&str> {
        let is_seen = |centre_nm: &f64| VISIBLE_NM.contains(centre_nm);
        let at = self.centre_nm.iter().position(|centre_nm| !is_seen(centre_nm))?;
        Some(&self.name[at])
    }

    /// In words, such as "red 620 nm (60 nm wide), green 530 nm (70 nm wide), blue 460 nm (25 nm wide), made by the camera".
    #[must_use]
    pub fn words(&self) -> String {
        format!(
            "{}, made by the {}",
            self.labels().join(", "),
            self.made_by.word()
        )
    }

    /// Each in words, such as "red 620 nm (60 nm wide)".
    #[must_use]
    pub fn labels(&self) -> Vec<String> {
        let each = self.name.iter().zip(self.centre_nm.iter().zip(&self.width_nm));
        each.map(|(name, (centre_nm, width_nm))| format!("{name} {centre_nm} nm ({width_nm} nm wide)"))
            .collect()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Those that a projector makes.
    pub(crate) fn in_turn() -> Bands {
        Bands {
            made_by: MadeBy::Projector,
            ..bands()
        }
    }

    fn bands() -> Bands {
        Bands {
            made_by: MadeBy::Camera,
            name: ["red", "green", "blue"].map(str::to_owned).to_vec(),
            centre_nm: vec![620.0, 530.0, 460.0],
            width_nm: vec![60.0, 70.0, 25.0],
        }
    }

    #[test]
    fn only_bands_of_the_same_light_are_compared() {
        let named = Bands {
            name: ["R", "G", "B"].map(str::to_owned).to_vec(),
            made_by: MadeBy::Projector,
            ..bands()
        };
        assert!(named.is_same_light(&bands()) && named.is_near(&bands()));
        let with = |centre_nm: [f64; 3]| Bands {
            centre_nm: centre_nm.to_vec(),
            ..bands()
        };
        assert!(!with([621.0, 530.0, 460.0]).is_same_light(&bands()));
        assert!(with([621.0, 530.0, 460.0]).is_near(&bands()));
        assert!(!with([460.0, 530.0, 620.0]).is_near(&bands()));
        let one = |width_nm: f64| Bands {
            made_by: MadeBy::Camera,
            name: vec!["all".to_owned()],
            centre_nm: vec![540.0],
            width_nm: vec![width_nm],
        };
        assert!(one(160.0).is_near(&bands()) && !one(159.0).is_near(&bands()));
        assert!(!one(160.0).is_same_light(&bands()));
        assert_eq!(bands().invisible(), None);
        assert_eq!(with([620.0, 530.0, 850.0]).invisible(), Some("blue"));
    }

    #[test]
    fn bands_come_back_from_a_file_and_others_do_not() {
        let stated = bands().to_json();
        assert_eq!(Bands::of_json(&stated, 3), Some(bands()));
        assert_eq!(Bands::of_json(&stated, 1), None);
        let mut wrong = stated.clone();
        wrong["centre_nm"][1] = json!(0.53);
        assert_eq!(Bands::of_json(&wrong, 3), None);
        assert_eq!(
            bands().words(),
            "red 620 nm (60 nm wide), green 530 nm (70 nm wide), blue 460 nm (25 nm wide), made by the camera"
        );
    }
}
