//! Which unit is meant: those on USB, or one whose reports come over TCP.

use serde::Serialize;

use super::reports::{Reports, TCP, TcpReports};
use crate::capture::projector::ProjectorError;

/// What a HID device is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// The one of this driver.
    Dlpc900,
    /// That of a LightCrafter 4500; see [`video`](super::video).
    Dlpc350,
}

impl Kind {
    /// Texas Instruments, and the products.
    const VENDOR: u16 = 0x0451;
    const PRODUCTS: [(u16, Self); 2] = [(0xC900, Self::Dlpc900), (0x6401, Self::Dlpc350)];

    /// The one of these numbers on USB.
    #[must_use]
    pub fn of(vendor: u16, product: u16) -> Option<Self> {
        let mut products = Self::PRODUCTS.into_iter();
        let found = products.find(|(of_it, _)| (vendor, product) == (Self::VENDOR, *of_it));
        found.map(|(_, kind)| kind)
    }

    /// What a person knows it by.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dlpc900 => "DLPC900",
            Self::Dlpc350 => "DLPC350 (LightCrafter 4500)",
        }
    }
}

/// A unit on USB.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Found {
    /// What it is.
    pub kind: Kind,
    /// Its device file.
    pub path: String,
    /// Its serial number; it may have none.
    pub serial: String,
}

impl Found {
    fn is_meant(&self, wanted: Option<&str>) -> bool {
        let wanted = wanted.unwrap_or_default();
        self.path == wanted || self.serial.contains(wanted)
    }

    fn words(&self) -> String {
        match self.serial.as_str() {
            "" => format!("{} without a serial number", self.path),
            serial => format!("{} with serial number {serial}", self.path),
        }
    }
}

/// The units on USB that this program knows, by their paths.
///
/// # Errors
/// [`ProjectorError::Failed`] where the system does not list them, or the program was built without the feature `dlpc900`.
pub fn list() -> Result<Vec<Found>, ProjectorError> {
    #[cfg(feature = "dlpc900")]
    let found = super::hid::list();
    #[cfg(not(feature = "dlpc900"))]
    let found = Err(
        "expected a program that was built with `--features dlpc900`, found one without (`cargo build --release --features dlpc900`)"
            .to_owned(),
    );
    found.map_err(|reason| failed("dlpc900", reason))
}

fn failed(projector: &str, reason: String) -> ProjectorError {
    ProjectorError::Failed {
        projector: projector.to_owned(),
        reason,
    }
}

/// A unit whose reports come and go.
pub struct Opened {
    /// What it is; over TCP a DLPC900.
    pub kind: Kind,
    /// What people know it by.
    pub name: String,
    /// Its reports.
    pub reports: Box<dyn Reports>,
}

/// The only unit that is `wanted` and one of these `kinds`.
///
/// # Errors
/// [`ProjectorError::Failed`] where there is none or several, or it cannot be opened.
pub fn open(wanted: Option<&str>, kinds: &[Kind]) -> Result<Opened, ProjectorError> {
    if let Some(address) = wanted.and_then(|wanted| wanted.strip_prefix(TCP)) {
        let name = format!("{TCP}{address}");
        let reports = TcpReports::connect(address).map_err(|error| {
            failed(
                &name,
                format!("expected a unit's reports at a host and a port, such as tcp:127.0.0.1:7000, found {error}"),
            )
        })?;
        return Ok(Opened {
            kind: Kind::Dlpc900,
            name,
            reports: Box::new(reports),
        });
    }
    let found = only_one(list()?, wanted, kinds)?;
    Ok(Opened {
        kind: found.kind,
        reports: reports_at(&found.path)?,
        name: found.path,
    })
}

#[cfg(feature = "dlpc900")]
fn reports_at(path: &str) -> Result<Box<dyn Reports>, ProjectorError> {
    let reports = super::hid::HidReports::open(path).map_err(|error| failed(path, error))?;
    Ok(Box::new(reports))
}

#[cfg(not(feature = "dlpc900"))]
fn reports_at(path: &str) -> Result<Box<dyn Reports>, ProjectorError> {
    Err(failed(
        path,
        "expected the feature `dlpc900`, found a program without".to_owned(),
    ))
}

/// The only one of `found` that is `wanted` and one of these `kinds`.
fn only_one(found: Vec<Found>, wanted: Option<&str>, kinds: &[Kind]) -> Result<Found, ProjectorError> {
    let (ours, others): (Vec<Found>, Vec<Found>) =
        found.into_iter().partition(|found| kinds.contains(&found.kind));
    let meant: Vec<&Found> = ours.iter().filter(|found| found.is_meant(wanted)).collect();
    let words = |found: &[&Found]| {
        found
            .iter()
            .map(|found| found.words())
            .collect::<Vec<_>>()
            .join(", ")
    };
    let expected = wanted.map_or_else(|| "dlpc900".to_owned(), str::to_owned);
    match (&meant[..], &ours[..], &others[..]) {
        ([one], ..) => Ok((*one).clone()),
        ([], [], []) => Err(failed(
            &expected,
            "expected a DLPC900 on USB (0451:c900), found none; connect it and switch it on".to_owned(),
        )),
        ([], [], [other, ..]) => Err(failed(
            &expected,
            format!(
                "expected a DLPC900 on USB (0451:c900), found a {} at {}, which takes no patterns over USB",
                other.kind.name(),
                other.path
            ),
        )),
        ([], ours, _) => Err(failed(
            &expected,
            format!(
                "expected a DLPC900 of this serial number or device file, found {}",
                words(&ours.iter().collect::<Vec<_>>())
            ),
        )),
        (several, ..) => Err(failed(
            &expected,
            format!(
                "expected one DLPC900, found {}; name one by `device` in [projector.dlpc900]",
                words(several)
            ),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_one_that_is_meant_is_taken_and_others_are_named() {
        let unit = |kind, path: &str, serial: &str| Found {
            kind,
            path: path.to_owned(),
            serial: serial.to_owned(),
        };
        let [first, second] = [("0", "A17"), ("1", "A18")]
            .map(|(number, serial)| unit(Kind::Dlpc900, &format!("/dev/hidraw{number}"), serial));
        let crafter = unit(Kind::Dlpc350, "/dev/hidraw2", "");
        let all = vec![first.clone(), second.clone(), crafter.clone()];
        let of = |found: &[Found], wanted| only_one(found.to_vec(), wanted, &[Kind::Dlpc900]);
        let said = |found: &[Found], wanted| of(found, wanted).unwrap_err().to_string();
        assert_eq!(of(&[crafter.clone(), first.clone()], None).unwrap(), first);
        for wanted in ["A18", "18", "/dev/hidraw1"] {
            assert_eq!(of(&all, Some(wanted)).unwrap(), second, "{wanted}");
        }
        assert!(said(&[], None).contains("found none; connect it"));
        assert!(said(&[crafter], None).contains("found a DLPC350 (LightCrafter 4500) at /dev/hidraw2"));
        let several = said(&all, Some("A1"));
        assert!(
            several.contains("hidraw0 with serial number A17, /dev/hidraw1 with"),
            "{several}"
        );
        assert!(said(&all, Some("B")).contains("projector B: expected a DLPC900 of this serial number"));
    }
}
