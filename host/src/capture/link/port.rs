//! Finding the trigger box's port, and opening it.

use serialport::{SerialPortInfo, SerialPortType};

use super::{Link, LinkError, SerialLink};

/// Vendor and product of the trigger box on USB. They are the test ids of pid.codes, which others use too.
const USB_ID: (u16, u16) = (0x1209, 0x0001);
/// What tells it from those others.
const USB_PRODUCT: &str = "RCG trigger box";

/// What a name begins with that is a serial number.
const SERIAL: &str = "serial:";

/// The link to the trigger box at the port `name` (`/dev/ttyACM0`, `COM3`), with `auto` to the only one on USB, or with
/// `serial:` and its serial number to that one, wherever it is plugged in.
///
/// # Errors
/// [`LinkError`].
pub fn open(name: &str) -> Result<Box<dyn Link>, LinkError> {
    let found;
    let name = if name == "auto" {
        found = only_one(&serial_ports())?;
        &found
    } else if let Some(serial) = name.strip_prefix(SERIAL) {
        found = of_serial(&serial_ports(), serial)?;
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

/// The port of the trigger box on USB with this serial number, in whatever case its digits are.
fn of_serial(ports: &[SerialPortInfo], serial: &str) -> Result<String, LinkError> {
    let number = |port: &SerialPortInfo| match &port.port_type {
        SerialPortType::UsbPort(usb) => usb.serial_number.clone().unwrap_or_default(),
        _ => String::new(),
    };
    let boxes: Vec<(&str, String)> = ports
        .iter()
        .filter(|port| is_trigger_box(port))
        .map(|port| (port.port_name.as_str(), number(port)))
        .filter(|(_, number)| !number.is_empty())
        .collect();
    let found = boxes
        .iter()
        .find(|(_, number)| number.eq_ignore_ascii_case(serial));
    found
        .map(|(name, _)| (*name).to_owned())
        .ok_or_else(|| LinkError::NoSuchSerial {
            serial: serial.to_owned(),
            available: boxes.iter().map(|(_, number)| number.clone()).collect(),
        })
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

    fn with_serial(mut port: SerialPortInfo, serial: &str) -> SerialPortInfo {
        if let SerialPortType::UsbPort(usb) = &mut port.port_type {
            usb.serial_number = Some(serial.to_owned());
        }
        port
    }

    #[test]
    #[cfg(not(windows))]
    fn two_boxes_are_told_apart_by_their_serial_numbers() {
        let mut ports = others();
        // Somebody else's device may have the number of one of ours.
        ports[1] = with_serial(ports[1].clone(), "e661a4d41770a001");
        for (name, serial) in [
            ("/dev/ttyACM3", "e661a4d41770a001"),
            ("/dev/ttyACM4", "e661a4d41770a002"),
        ] {
            ports.push(with_serial(usb(name, USB_ID, Some(USB_PRODUCT)), serial));
        }
        assert_eq!(of_serial(&ports, "e661a4d41770a001").unwrap(), "/dev/ttyACM3");
        assert_eq!(of_serial(&ports, "E661A4D41770A002").unwrap(), "/dev/ttyACM4");
        let error = of_serial(&ports, "e661a4d41770a003").unwrap_err().to_string();
        assert!(
            error.contains("expected a trigger box on USB with this serial number")
                && error.contains("e661a4d41770a001, e661a4d41770a002"),
            "{error}"
        );
        for serial in ["1", ""] {
            let none = of_serial(&others(), serial).unwrap_err().to_string();
            assert!(none.ends_with("found none"), "{none}");
        }
    }

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
