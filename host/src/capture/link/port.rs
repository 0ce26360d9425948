//! Finding the trigger box's port, and opening it.

use serialport::{SerialPortInfo, SerialPortType};

use super::{Link, LinkError, SerialLink};

/// Vendor and product of the trigger box on USB. They are the test ids of pid.codes, which others use too.
const USB_ID: (u16, u16) = (0x1209, 0x0001);
/// What tells it from those others.
const USB_PRODUCT: &str = "RCG trigger box";

/// The link to the trigger box at the port `name` (`/dev/ttyACM0`, `COM3`), or with `auto` to the only one on USB.
///
/// # Errors
/// [`LinkError`].
pub fn open(name: &str) -> Result<Box<dyn Link>, LinkError> {
    let found;
    let name = if name == "auto" {
        found = only_one(&serial_ports())?;
        &found
    } else {
        name
    };
    Ok(Box::new(SerialLink::open(name)?))
}

/// A number for [`Device::connect`](crate::capture::device::Device::connect) that differs from those before: the nanoseconds of
/// the system's clock.
#[must_use]
pub fn nonce() -> u32 {
    std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(1, |since| since.as_nanos() as u32)
}

/// Names of the serial ports of this machine.
#[must_use]
pub fn ports() -> Vec<String> {
    serial_ports().into_iter().map(|port| port.port_name).collect()
}

fn serial_ports() -> Vec<SerialPortInfo> {
    // The library insists on this directory, which some containers lack.
    if cfg!(target_os = "linux") && !std::path::Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    serialport::available_ports().unwrap_or_default()
}

fn only_one(ports: &[SerialPortInfo]) -> Result<String, LinkError> {
    let boxes: Vec<String> = ports
        .iter()
        .filter(|port| is_trigger_box(port))
        .map(|port| port.port_name.clone())
        .collect();
    match &boxes[..] {
        [only] => Ok(only.clone()),
        [] => Err(LinkError::NoTriggerBox {
            available: ports.iter().map(|port| port.port_name.clone()).collect(),
        }),
        _ => Err(LinkError::SeveralTriggerBoxes { found: boxes }),
    }
}

fn is_trigger_box(port: &SerialPortInfo) -> bool {
    let SerialPortType::UsbPort(usb) = &port.port_type else {
        return false;
    };
    // macOS lists each port twice; those of this name wait for a modem's carrier.
    let waits = port.port_name.starts_with("/dev/tty.");
    // Windows tells its driver's name in place of the product's.
    let named = cfg!(windows) || usb.product.as_deref().is_none_or(|name| name == USB_PRODUCT);
    (usb.vid, usb.pid) == USB_ID && named && !waits
}

#[cfg(test)]
mod tests {
    use serialport::UsbPortInfo;

    use super::*;

    fn usb(name: &str, id: (u16, u16), product: Option<&str>) -> SerialPortInfo {
        SerialPortInfo {
            port_name: name.to_owned(),
            port_type: SerialPortType::UsbPort(UsbPortInfo {
                vid: id.0,
                pid: id.1,
                serial_number: None,
                manufacturer: None,
                product: product.map(str::to_owned),
            }),
        }
    }

    /// What has the ids, or the name, or neither.
    fn others() -> Vec<SerialPortInfo> {
        vec![
            SerialPortInfo {
                port_name: "/dev/ttyS0".to_owned(),
                port_type: SerialPortType::Unknown,
            },
            usb("/dev/ttyACM0", USB_ID, Some("Somebody's clock")),
            usb("/dev/ttyACM1", (0x2e8a, 0x0005), Some(USB_PRODUCT)),
            usb("/dev/tty.usbmodem1", USB_ID, Some(USB_PRODUCT)),
        ]
    }

    #[test]
    #[cfg(not(windows))]
    fn the_only_trigger_box_is_found_among_others() {
        for product in [Some(USB_PRODUCT), None] {
            let mut ports = others();
            ports.insert(2, usb("/dev/ttyACM7", USB_ID, product));
            assert_eq!(only_one(&ports).unwrap(), "/dev/ttyACM7");
        }
    }

    #[test]
    #[cfg(not(windows))]
    fn none_and_several_are_told_with_the_ports_to_choose_from() {
        let none = only_one(&others()).unwrap_err().to_string();
        assert!(
            none.contains("expected one trigger box on USB (1209:0001"),
            "{none}"
        );
        assert!(
            none.contains("found none") && none.contains("/dev/ttyS0, /dev/ttyACM0"),
            "{none}"
        );
        let nothing = only_one(&[]).unwrap_err().to_string();
        assert!(
            nothing.contains("no serial ports") && nothing.contains("sim"),
            "{nothing}"
        );
        let mut ports = others();
        ports.push(usb("COM3", USB_ID, Some(USB_PRODUCT)));
        ports.push(usb("COM4", USB_ID, Some(USB_PRODUCT)));
        let several = only_one(&ports).unwrap_err().to_string();
        assert!(
            several.contains("found 2: COM3, COM4") && several.contains("--port COM3"),
            "{several}"
        );
    }
}
