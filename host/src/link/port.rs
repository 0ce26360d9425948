//! Opening the trigger box's port by name.

use super::{Link, LinkError, SerialLink};

/// The link to the trigger box at the port `name`.
///
/// # Errors
/// [`LinkError`].
pub fn open(name: &str) -> Result<Box<dyn Link>, LinkError> {
    Ok(Box::new(SerialLink::open(name)?))
}

/// A number for [`Device::connect`](crate::device::Device::connect) that differs from those before: the nanoseconds of
/// the system's clock.
#[must_use]
pub fn nonce() -> u32 {
    std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(1, |since| since.as_nanos() as u32)
}
