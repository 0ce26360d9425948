//! The GigE Vision camera against a client of its own, written from the standard's side.

mod client;
mod control;
mod frames;

use client::{Client, address};
use rcg_hil::gige::{GigeCamera, PixelFormat, Settings};

const STREAM_PORT: u32 = 0xd00;
const PACKET_SIZE: u32 = 0xd04;
const WIDTH: u32 = 0x1_0008;
const PIXEL_FORMAT: u32 = 0x1_0018;
const ACQUISITION: u32 = 0x1_0024;
const TRIGGER: u32 = 0x1_0080;

fn settings() -> Settings {
    Settings {
        address: address(),
        sensor_px: (320, 240),
        formats: PixelFormat::ALL.to_vec(),
        broadcast: false,
        ..Settings::default()
    }
}

/// A camera that waits for its line, and the client that made it wait.
fn armed(settings: Settings) -> (GigeCamera, Client) {
    let camera = GigeCamera::start(settings).unwrap();
    let mut client = Client::new(camera.address());
    client.control();
    client.set(&[(WIDTH, 24), (WIDTH + 4, 10)]);
    client.open_stream();
    client.set(&[(TRIGGER, 1), (TRIGGER + 4, 1), (ACQUISITION, 1)]);
    (camera, client)
}

/// Exposes an image of the region that is set; the frame's id.
fn expose(camera: &GigeCamera) -> u64 {
    let image = vec![7; camera.config().image_bytes()];
    let sent = camera.expose(&image, 1_000, 1.0).unwrap();
    sent.id().expect("it is armed")
}
