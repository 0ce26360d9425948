//! Discovery, XML, privilege, registers, and what is no command.

use std::net::SocketAddrV4;
use std::time::{Duration, Instant};

use rcg_hil::gige::{
    AcquisitionMode, ExposureMode, GigeCamera, GigeError, Idle, PixelFormat, Sent, Settings,
    TriggerActivation, TriggerSource,
};

use crate::client::{Chance, Client};
use crate::{ACQUISITION, PACKET_SIZE, PIXEL_FORMAT, STREAM_PORT, TRIGGER, WIDTH, armed, settings};

const HEARTBEAT: u32 = 0x938;
const PRIVILEGE: u32 = 0xa00;

const DENIED: u16 = 0x8006;

#[test]
fn a_discovery_is_answered_with_the_bootstrap_registers() {
    let settings = settings();
    let at = settings.address;
    let camera = GigeCamera::start(Settings {
        serial: "A-17".into(),
        ..settings
    })
    .unwrap();
    let mut client = Client::new(camera.address());
    let (status, code, bytes) = client.ask(0x02, &[]).unwrap();
    assert_eq!((status, code, bytes.len()), (0, 3, 0xf8));
    assert_eq!(bytes[..8], [0, 1, 0, 2, 0x80, 0, 0, 1]);
    assert_eq!(bytes[0x24..0x28], at.octets());
    assert_eq!(&bytes[0x48..0x4c], b"RCG\0");
    assert_eq!(&bytes[0xd8..0xdd], b"A-17\0");
    // The same memory by another command.
    assert_eq!(client.memory(0, 0xf8).unwrap(), bytes);
    // A second camera cannot have the address, until the first is off.
    let again = || {
        GigeCamera::start(Settings {
            address: at,
            ..self::settings()
        })
    };
    assert!(matches!(again(), Err(GigeError::Start { .. })));
    drop(camera);
    assert!(again().is_ok());
}

#[test]
fn the_xml_is_at_its_url_and_every_register_and_node_that_it_names_is_there() {
    for chunks in [true, false] {
        let camera = GigeCamera::start(Settings { chunks, ..settings() }).unwrap();
        let mut client = Client::new(camera.address());
        client.control();
        let url = String::from_utf8(client.memory(0x200, 512).unwrap()).unwrap();
        let mut parts = url.trim_end_matches('\0').split(';');
        assert!(parts.next().unwrap().starts_with("Local:"));
        let mut number = || u32::from_str_radix(parts.next().unwrap(), 16).unwrap();
        let (at, length) = (number(), number());
        let mut xml = Vec::new();
        while (xml.len() as u32) < length {
            let rest = (length - xml.len() as u32).next_multiple_of(4).min(512);
            xml.extend(client.memory(at + xml.len() as u32, rest as u16).unwrap());
        }
        xml.truncate(length as usize);
        let xml = String::from_utf8(xml).unwrap();
        assert!(xml.trim_end().ends_with("</RegisterDescription>"));
        let between = |text: &str, from: &str, to: &str| -> Vec<String> {
            let pieces = text.split(from).skip(1);
            pieces
                .map(|piece| piece.split(to).next().unwrap().to_owned())
                .collect()
        };
        let names = between(&xml, " Name=\"", "\"");
        for tag in [
            "pFeature>",
            "pValue>",
            "pPort>",
            "pMax>",
            "pIsLocked>",
            "pSelected>",
        ] {
            for name in between(&xml, &format!("<{tag}"), "<") {
                assert!(names.contains(&name), "{tag}{name}");
            }
        }
        let mut registers = 0;
        for node in between(&xml, "<Address>0x", "</Endianess>") {
            if !node.contains("<pPort>Device<") {
                continue;
            }
            let at = u32::from_str_radix(node.split('<').next().unwrap(), 16).unwrap();
            let length: u16 = between(&node, "<Length>", "<")[0].parse().unwrap();
            let banks = if node.contains("<pIndex") { 2 } else { 1 };
            for bank in 0..banks {
                let offset = between(&node, "Offset=\"", "\"")
                    .first()
                    .map_or(0, |text| text.parse().unwrap());
                let there = client.memory(at + bank * offset, length);
                assert_eq!(there.map(|bytes| bytes.len()), Ok(length.into()), "{at:x}");
            }
            registers += 1;
        }
        assert!(registers > 35, "{registers}");
        assert_eq!(xml.contains("Chunk"), chunks);
    }
}

#[test]
fn one_client_controls_until_it_releases_or_falls_silent() {
    let camera = GigeCamera::start(settings()).unwrap();
    let (mut first, mut second) = (Client::new(camera.address()), Client::new(camera.address()));
    assert_eq!(first.write(WIDTH, 96), Err(DENIED), "nobody controls yet");
    first.control();
    assert_eq!(first.write(WIDTH, 96), Ok(()));
    assert_eq!(second.write(PRIVILEGE, 2), Err(DENIED));
    assert_eq!(second.write(WIDTH, 64), Err(DENIED));
    assert_eq!(second.write_memory(WIDTH, &64_u32.to_be_bytes()), Err(DENIED));
    assert_eq!(second.read(WIDTH), Ok(96));
    assert_eq!(second.read(PRIVILEGE), Ok(2));
    assert_eq!(second.read(0xa04), Ok(first.port().into()));
    // Exclusively: nobody else reads either.
    first.set(&[(PRIVILEGE, 1)]);
    assert_eq!(second.read(WIDTH), Err(DENIED));
    first.set(&[(PRIVILEGE, 0)]);
    second.control();
    second.open_stream();
    second.set(&[(ACQUISITION, 1), (HEARTBEAT, 500)]);
    let start = Instant::now();
    while camera.counts().control_lost == 0 {
        assert!(start.elapsed() < Duration::from_secs(20), "control is never lost");
        std::thread::sleep(Duration::from_millis(10));
    }
    let config = camera.config();
    assert_eq!(
        (config.acquiring, config.destination, config.controller),
        (false, None, None)
    );
    assert_eq!(second.write(WIDTH, 64), Err(DENIED));
    first.control();
}

#[test]
fn registers_refuse_what_the_camera_cannot_do() {
    let camera = GigeCamera::start(Settings {
        step_px: (4, 2),
        formats: vec![PixelFormat::Mono8, PixelFormat::Mono12],
        exposure_step_us: 2.5,
        ..settings()
    })
    .unwrap();
    let mut client = Client::new(camera.address());
    client.control();
    let (parameter, address, protected, alignment) = (0x8002, 0x8003, 0x8004, 0x8005);
    for (at, value, expected) in [
        (WIDTH, 98, parameter),
        (WIDTH, 0, parameter),
        (WIDTH, 324, parameter),
        (WIDTH + 8, 4, parameter),
        (PIXEL_FORMAT, PixelFormat::Mono16.code(), parameter),
        (ACQUISITION, 2, parameter),
        (HEARTBEAT, 499, parameter),
        (PACKET_SIZE, 216, parameter),
        (PACKET_SIZE, 65_504, parameter),
        (PACKET_SIZE, 1501, parameter),
        (STREAM_PORT, 65_536, parameter),
        (0xd18, 0x0808_0808, parameter),
        // Half of an exposure time.
        (0x1_0048, 0, parameter),
        (0x1_004c, 0, parameter),
        (0x1_0000, 64, protected),
        (0x1_001c, 64, protected),
        (0x24, 1, protected),
        (0x2_0000, 1, protected),
        (WIDTH + 1, 96, alignment),
        (0x1_00d0, 0, address),
        (0xffff_fffc, 0, address),
    ] {
        assert_eq!(client.write(at, value), Err(expected), "{at:x} {value}");
    }
    assert_eq!(client.read(0x1000), Err(address));
    assert_eq!(client.read(WIDTH + 2), Err(alignment));
    assert_eq!(client.memory(0x200, 540), Err(parameter));
    assert_eq!(client.memory(0x200, 6), Err(parameter));
    assert_eq!(client.memory(0xffc, 8), Err(address));
    assert_eq!(client.ask(0x100, &[0; 12]).unwrap().0, 0x8001, "actions");
    assert_eq!(client.ask(0x80, &[0; 6]).unwrap().0, parameter);
    // Floating-point numbers, whole; the sensor's clock makes steps of the exposure time.
    for (at, value, expected) in [
        (0x1_0048, 1234.0, Ok(())),
        (0x1_0048, 0.5, Err(parameter)),
        (0x1_0048, f64::NAN, Err(parameter)),
        (0x1_0050, -0.1, Err(parameter)),
        (0x1_0050, 6.5, Ok(())),
    ] {
        assert_eq!(
            client.write_memory(at, &value.to_bits().to_be_bytes()),
            expected,
            "{value}"
        );
    }
    let config = camera.config();
    assert!((config.exposure_us - 1235.0).abs() < 1e-9 && (config.gain_db - 6.5).abs() < 1e-9);
    // What has its place in frames does not change under them.
    client.set(&[(WIDTH, 64), (WIDTH + 8, 256), (ACQUISITION, 1)]);
    assert_eq!(client.write(WIDTH, 32), Err(DENIED));
    assert_eq!(client.write_memory(0xe8, b"bench\0\0\0"), Ok(()));
    assert_eq!(client.memory(0xe8, 8).unwrap(), b"bench\0\0\0");
}

#[test]
fn what_a_client_sets_is_what_the_camera_does() {
    let camera = GigeCamera::start(settings()).unwrap();
    let mut client = Client::new(camera.address());
    client.control();
    client.set(&[
        (0x1_0020, 1),
        (0x1_0030, 1),
        (TRIGGER + 16, 1),
        (TRIGGER, 1),
        (TRIGGER + 4, 2),
        (TRIGGER + 8, 1),
        (0x1_00ac, 1),
    ]);
    let config = camera.config();
    assert_eq!(config.acquisition_mode, AcquisitionMode::SingleFrame);
    assert_eq!(config.exposure_mode, ExposureMode::TriggerWidth);
    assert!(config.acquisition_start.on && config.frame_start.on && config.exposure_active);
    assert_eq!(config.frame_start.source, TriggerSource::Line3);
    assert_eq!(config.frame_start.activation, TriggerActivation::FallingEdge);
    // Each reason for which no frame is exposed, until one is; after which a single one was all.
    let image = vec![0; config.image_bytes()];
    let idle = |camera: &GigeCamera| {
        let said = camera.idle();
        let idle = match camera.expose(&image, 0, 1.0).unwrap() {
            Sent::Idle(idle) => Some(idle),
            _ => None,
        };
        assert_eq!(said, idle);
        idle
    };
    assert_eq!(idle(&camera), Some(Idle::NotAcquiring));
    client.set(&[(ACQUISITION, 1)]);
    assert_eq!(idle(&camera), Some(Idle::NoStream));
    client.open_stream();
    assert_eq!(idle(&camera), Some(Idle::AwaitsAcquisitionStart));
    client.set(&[(TRIGGER + 16, 0)]);
    assert_eq!(idle(&camera), Some(Idle::OtherSource));
    client.set(&[(TRIGGER + 4, 1)]);
    let found = camera.expose(&image[1..], 0, 1.0).unwrap_err();
    assert!(matches!(found, GigeError::Image { .. }), "{found}");
    assert_eq!(idle(&camera), None);
    assert_eq!(idle(&camera), Some(Idle::NotAcquiring));
    assert_eq!(camera.counts().frames, 1);
}

#[test]
fn hostile_datagrams_change_nothing() {
    let (camera, mut client) = armed(Settings {
        extended_ids: true,
        ..settings()
    });
    let stranger = SocketAddrV4::new([127, 0, 0, 1].into(), 9);
    let mut chance = Chance(3);
    let mut datagram = Vec::new();
    // Lengths that are not so, no number, no command of this protocol.
    for (bytes, status) in [
        (&[0x42, 1, 0, 0x80, 0, 4, 0, 1, 0, 0, 0, 0][..], Some(0)),
        (&[0x42, 1, 0, 0x80, 0, 8, 0, 1, 0, 0, 0, 0], Some(0x800e)),
        (&[0x42, 1, 0, 0x80, 0, 4, 0, 1, 0, 0, 0, 0, 0], Some(0x800e)),
        (&[0x42, 1, 0, 0x80, 0, 4, 0, 0, 0, 0, 0, 0], Some(0x800e)),
        (&[0x42, 0, 0, 0x80, 0, 4, 0, 1, 0, 0, 0, 0], None),
        (&[0x41, 1, 0, 0x80, 0, 4, 0, 1, 0, 0, 0, 0], None),
        (&[0x42, 1, 0, 0x80, 0, 4, 0], None),
    ] {
        let answer = camera.hear(stranger, bytes);
        let found = answer.map(|answer| u16::from_be_bytes([answer[0], answer[1]]));
        assert_eq!(found, status, "{bytes:x?}");
    }
    for draw in 0..100_000_u32 {
        datagram.clear();
        match draw % 4 {
            // Anything.
            0 => datagram.extend((0..chance.below(64)).map(|_| chance.next() as u8)),
            // A command with anything in it, whole, cut off or too long.
            1 | 2 => {
                let code = [0x02, 0x40, 0x80, 0x82, 0x84, 0x86, 0x100][chance.below(7)];
                let length = [0, 4, 8, 12, 20, 540][chance.below(6)];
                let flags = [0, 1, 0x10, 0x11][chance.below(4)];
                datagram.extend([0x42, flags, (code >> 8) as u8, code as u8]);
                datagram.extend((length as u16).to_be_bytes());
                datagram.extend((chance.next() as u16).to_be_bytes());
                datagram.extend((0..length).map(|_| chance.next() as u8));
                if draw % 4 == 2 {
                    datagram.resize(chance.below(datagram.len() + 8), 0xff);
                }
            }
            // As long as datagrams get.
            _ => datagram.extend(std::iter::repeat_n(0x42, chance.below(1500))),
        }
        if let Some(answer) = camera.hear(stranger, &datagram) {
            assert!((8..=548).contains(&answer.len()));
            assert_eq!(
                usize::from(answer[4]) << 8 | usize::from(answer[5]),
                answer.len() - 8
            );
        }
    }
    // The same from who controls the camera, who may break much, but not the camera.
    for draw in 0..20_000_u32 {
        let at = [0x900, 0xd00, 0x1_0000, 0x2_0000][chance.below(4)] + 4 * chance.below(64) as u32;
        let value = [0, 1, 2, 96, 0xffff_ffff, chance.next() as u32][chance.below(6)];
        datagram.clear();
        datagram.extend([0x42, 1, 0, if draw % 2 == 0 { 0x82 } else { 0x86 }, 0, 8, 0, 1]);
        datagram.extend(at.to_be_bytes());
        datagram.extend(value.to_be_bytes());
        camera.hear(client.address(), &datagram);
    }
    client.set(&[(PRIVILEGE, 0)]);
    client.control();
    let config = camera.config();
    assert!(config.region.width + config.region.offset_x <= 320 && config.image_bytes() > 0);
}
