//! Reports of HID devices, by the kernel's hidraw.

use std::ffi::CString;
use std::time::Duration;

use hidapi::{HidApi, HidDevice};

use super::choose::{Found, Kind};
use super::reports::{REPORT, Reports};

/// The units that this program knows, by their paths.
pub(super) fn list() -> Result<Vec<Found>, String> {
    let api = HidApi::new().map_err(|error| error.to_string())?;
    let mut found: Vec<Found> = api
        .device_list()
        .filter_map(|device| {
            Some(Found {
                kind: Kind::of(device.vendor_id(), device.product_id())?,
                path: device.path().to_string_lossy().into_owned(),
                serial: device.serial_number().unwrap_or_default().to_owned(),
            })
        })
        .collect();
    found.sort_by(|a, b| a.path.cmp(&b.path));
    // A device has an entry for each of its uses.
    found.dedup();
    Ok(found)
}

/// A device file.
pub(super) struct HidReports(HidDevice);

impl HidReports {
    /// That at `path`.
    pub(super) fn open(path: &str) -> Result<Self, String> {
        let name = CString::new(path).map_err(|error| error.to_string())?;
        let api = HidApi::new().map_err(|error| error.to_string())?;
        let device = api.open_path(&name).map_err(|error| {
            // The library's error does not say of what kind it is; the system's does.
            let denied = std::fs::File::options().read(true).write(true).open(path);
            match denied {
                Err(denied) if denied.kind() == std::io::ErrorKind::PermissionDenied => {
                    "expected leave to read and write it, found none; write the line `KERNEL==\"hidraw*\", ATTRS{idVendor}==\"0451\", \
                     ATTRS{idProduct}==\"c900\", TAG+=\"uaccess\"` into /etc/udev/rules.d/70-dlpc900.rules and plug it in again"
                        .to_owned()
                }
                _ => format!("expected a HID device that opens, found {error}"),
            }
        })?;
        Ok(Self(device))
    }
}

impl Reports for HidReports {
    fn send(&mut self, report: &[u8; REPORT]) -> Result<(), String> {
        // The kernel wants the report's id first, and takes it off: there is but one.
        let mut bytes = [0; REPORT + 1];
        bytes[1..].copy_from_slice(report);
        let written = self.0.write(&bytes).map_err(|error| error.to_string())?;
        if written == bytes.len() {
            Ok(())
        } else {
            Err(format!(
                "expected {} bytes to be sent, found {written}",
                bytes.len()
            ))
        }
    }

    fn take(&mut self, patience: Duration) -> Result<Option<[u8; REPORT]>, String> {
        let mut report = [0; REPORT];
        let read = self
            .0
            .read_timeout(&mut report, patience.as_millis() as i32)
            .map_err(|error| error.to_string())?;
        match read {
            0 => Ok(None),
            REPORT => Ok(Some(report)),
            _ => Err(format!("expected a report of {REPORT} bytes, found {read}")),
        }
    }
}
