//! A GigE Vision camera for tests: real up to the sensor.
//!
//! # Design
//! What a client sees is what the standards say: GVCP commands on UDP port 3956 (`gvcp`, `control`), registers
//! (`map`, `registers`) that a GenICam XML describes (`xml`), frames as GVSP packets (`gvsp`, `stream`). What light
//! would do comes from whoever holds the camera: [`GigeCamera::expose`] takes an image for each trigger. Left alone
//! it sends test images, in its own time (`TriggerMode` off) or when told (`TriggerSource` software).
//!
//! Control and stream each have a lock, taken in this order. Frames are sent by whoever exposes them, packets that
//! are asked for again by the control channel's thread.
//!
//! Sources: GigE Vision 2.x (AIA), GenICam SFNC 2.x and PFNC 2.x (EMVA).
//!
//! # Tradeoffs
//! There are no events, actions, pending acknowledges, PTP, message channel or second stream; packet delay and the
//! bit that forbids fragments are kept without effect. Broadcasts are heard by one camera of a machine at a time, as
//! the port is not shared; the others are found at their addresses.

mod camera;
mod control;
mod faults;
mod gvcp;
mod gvsp;
mod map;
mod pixel_format;
mod registers;
mod settings;
mod stream;
mod test_image;
mod threads;
mod xml;

use std::io;
use std::net::SocketAddrV4;

pub use camera::{GigeCamera, Idle, Sent};
pub use faults::Faults;
pub use gvcp::PORT;
pub use pixel_format::PixelFormat;
pub use settings::{
    AcquisitionMode, Chunks, Config, ExposureMode, Region, Settings, Trigger, TriggerActivation,
    TriggerSource,
};
pub use stream::Counts;

/// Why there is no camera, or no frame.
#[derive(Debug, thiserror::Error)]
pub enum GigeError {
    /// Settings that no camera has.
    #[error("GigE camera, {field}: expected {expected}, found {found}")]
    Settings {
        /// The field.
        field: &'static str,
        /// What it can be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// The camera's address cannot be had, or a thread.
    #[error("GigE camera at {address}: {source}")]
    Start {
        /// The address.
        address: SocketAddrV4,
        /// What the system says.
        source: io::Error,
    },
    /// An image that is not of the region and format that are set.
    #[error("image: expected {expected} B for {width} × {height} pixels of {format}, found {found} B")]
    Image {
        /// Bytes of an image.
        expected: usize,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Name of the pixel format.
        format: &'static str,
        /// Bytes of this one.
        found: usize,
    },
}
