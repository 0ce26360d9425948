//! Frames: whole, with their ids, sent again, and wrong on purpose.

use rcg_hil::gige::{Faults, GigeCamera, Idle, PixelFormat, Sent, Settings};

use crate::client::{Block, Chance, Client, dn};
use crate::{ACQUISITION, PACKET_SIZE, PIXEL_FORMAT, STREAM_PORT, TRIGGER, WIDTH, armed, expose, settings};

#[test]
fn a_triggered_frame_arrives_whole_in_every_combination() {
    let mut chance = Chance(20_260_317);
    for draw in 0..80 {
        let (extended, tick_hz) = [
            (false, 1_000_000_000),
            (true, 1_000_000_000),
            (false, 125_000_000),
            (true, 125_000_000),
        ][draw % 4];
        let camera = GigeCamera::start(Settings {
            extended_ids: extended,
            first_id: 1 + chance.below(65_535) as u64,
            tick_hz,
            ..settings()
        })
        .unwrap();
        let mut client = Client::new(camera.address());
        client.control();
        let format = PixelFormat::ALL[chance.below(PixelFormat::ALL.len())];
        // So small that the client's system keeps all packets until they are read.
        let (width, height) = (1 + chance.below(90) as u32, 1 + chance.below(50) as u32);
        let (x, y) = (chance.below(200) as u32, chance.below(120) as u32);
        let packet_bytes = [220, 576, 1500, 9000, 65_500][chance.below(5)];
        let [with_chunks, with_id, with_time, with_exposure] = [(); 4].map(|()| chance.below(2) as u32);
        client.set(&[
            (WIDTH, width),
            (WIDTH + 4, height),
            (WIDTH + 8, x),
            (WIDTH + 12, y),
            (PIXEL_FORMAT, format.code()),
            (PACKET_SIZE, packet_bytes),
            (0x1_0040, with_chunks),
            (0x1_00c4, with_id),
            (0x1_00c8, with_time),
            (0x1_00cc, with_exposure),
        ]);
        client.open_stream();
        client.set(&[(TRIGGER, 1), (TRIGGER + 4, 1), (0x1_002c, 1), (ACQUISITION, 1)]);
        let image = format.pack(&dn(&mut chance, width * height * format.channels() as u32));
        let id = camera.expose(&image, 5_000_000_008, 12.5).unwrap().id().unwrap();
        let block = client.block(extended);
        let what = format!(
            "draw {draw}: {} {width}×{height} at {packet_bytes}",
            format.name()
        );
        let ticks = 5_000_000_008 * tick_hz / 1_000_000_000;
        assert_eq!((block.id, block.ticks), (id, ticks), "{what}");
        assert_eq!(block.format, format.code(), "{what}");
        assert_eq!(block.region, [width, height, x, y], "{what}");
        assert!(block.largest as u32 + 28 <= packet_bytes, "{what}");
        assert_eq!(Ok(block.payload.len() as u32), client.read(0x1_001c), "{what}");
        assert_eq!(block.image(), &image, "{what}");
        let chunks = [
            (with_exposure, 0xa3, 12.5_f64.to_bits()),
            (with_time, 0xa2, ticks),
            (with_id, 0xa1, id),
        ];
        let expected = chunks.iter().filter(|(on, ..)| on & with_chunks == 1);
        let expected: Vec<(u32, u64)> = expected.map(|&(_, chunk, value)| (chunk, value)).collect();
        assert_eq!(block.chunks(), expected, "{what}");
    }
}

#[test]
fn ids_wrap_jump_and_begin_again() {
    let first_id = 65_534;
    let (camera, mut client) = armed(Settings {
        first_id,
        ..settings()
    });
    let ids = |client: &Client, camera: &GigeCamera, count: usize| -> Vec<u64> {
        let next = || {
            expose(camera);
            client.block(camera.config().extended_ids).id
        };
        std::iter::repeat_with(next).take(count).collect()
    };
    assert_eq!(ids(&client, &camera, 4), [65_534, 65_535, 1, 2]);
    camera.set_faults(Faults {
        jumps: vec![(4, 10)],
        starved: vec![15],
        ..Faults::default()
    });
    camera.swallow();
    assert_eq!(ids(&client, &camera, 2), [3, 14]);
    assert_eq!(expose(&camera), 15);
    assert_eq!(ids(&client, &camera, 1), [16]);
    let counts = camera.counts();
    assert_eq!((counts.frames, counts.starved, counts.swallowed), (8, 1, 1));
    // The stream channel is opened again.
    client.set(&[(STREAM_PORT, 0)]);
    client.open_stream();
    assert_eq!(ids(&client, &camera, 1), [65_534]);
    drop(client);
    let (camera, client) = armed(Settings {
        first_id: 65_535,
        extended_ids: true,
        ids_per_acquisition: true,
        ..settings()
    });
    assert_eq!(ids(&client, &camera, 2), [65_535, 65_536]);
    let mut client = client;
    client.set(&[(ACQUISITION, 0), (ACQUISITION, 1)]);
    assert_eq!(ids(&client, &camera, 1), [65_535]);
}

#[test]
fn lost_packets_come_when_they_are_asked_for() {
    for extended in [false, true] {
        let (camera, mut client) = armed(Settings {
            extended_ids: extended,
            packet_bytes: 220,
            ..settings()
        });
        // 240 B: leader, two parts, trailer.
        camera.set_faults(Faults {
            lost: vec![(1, 1), (1, 3), (2, 2)],
            ..Faults::default()
        });
        expose(&camera);
        assert_eq!(
            client
                .packets(extended, 2)
                .iter()
                .map(|packet| packet.number)
                .collect::<Vec<_>>(),
            [0, 2]
        );
        client.resend(extended, 1, 1, 3);
        let again = client.packets(extended, 3);
        assert_eq!(
            again.iter().map(|packet| packet.number).collect::<Vec<_>>(),
            [1, 2, 3]
        );
        assert!(
            again
                .iter()
                .all(|packet| packet.id == 1 && packet.resent == extended)
        );
        assert!(again[0].bytes.iter().all(|&byte| byte == 7) && again[0].bytes.len() > 160);
        let counts = camera.counts();
        assert_eq!((counts.dropped, counts.resend_requests, counts.resent), (2, 1, 3));
        // To the end of the block, whatever that is.
        client.resend(extended, 1, 3, 0xff_ffff);
        let last = &client.packets(extended, 1)[0];
        assert_eq!((last.status, last.number), (0, 3));
        // A block that there is not.
        client.resend(extended, 9, 1, 1);
        assert_eq!(client.packets(extended, 1)[0].status, 0x800c);
        // For good.
        camera.set_faults(Faults {
            lost_for_good: true,
            ..camera.faults()
        });
        expose(&camera);
        client.packets(extended, 3);
        client.resend(extended, 2, 2, 3);
        assert_eq!(client.packets(extended, 1)[0].number, 3);
        // By chance: as many as is said, and the same whenever.
        camera.set_faults(Faults {
            packet_loss: 0.25,
            seed: 5,
            ..Faults::default()
        });
        let before = camera.counts();
        // Nobody reads them: the client's system throws away what is too much.
        for _ in 0..500 {
            expose(&camera);
        }
        let dropped = camera.counts().dropped - before.dropped;
        assert!((400..600).contains(&dropped), "{dropped} of 2000");
    }
}

#[test]
fn test_packets_have_the_size_that_is_asked_for() {
    let camera = GigeCamera::start(settings()).unwrap();
    let mut client = Client::new(camera.address());
    client.control();
    client.open_stream();
    for bytes in [220, 1500, 9000, 65_500] {
        client.set(&[(PACKET_SIZE, 0xc000_0000 | bytes)]);
        assert_eq!(client.datagram().len() as u32 + 28, bytes);
        assert_eq!(client.read(PACKET_SIZE), Ok(0x4000_0000 | bytes), "it fires once");
    }
}

#[test]
fn faults_are_what_they_say() {
    let (camera, mut client) = armed(settings());
    camera.set_faults(Faults {
        duplicated: vec![1],
        formats: vec![(2, PixelFormat::Mono16)],
        sizes: vec![(3, (20, 4))],
        clock_ppm: 50.0,
        ..Faults::default()
    });
    let image = vec![7; 240];
    for _ in 0..3 {
        camera.expose(&image, 1_000_000_000, 1.0).unwrap();
    }
    let blocks: Vec<Block> = (0..4).map(|_| client.block(false)).collect();
    let ids: Vec<u64> = blocks.iter().map(|block| block.id).collect();
    assert_eq!(ids, [1, 1, 2, 3]);
    assert_eq!(blocks[0].payload, blocks[1].payload);
    assert_eq!(
        (blocks[2].format, blocks[2].payload.len()),
        (PixelFormat::Mono16.code(), 480)
    );
    assert_eq!((blocks[3].region, blocks[3].payload.len()), ([20, 4, 0, 0], 80));
    assert_eq!(blocks[0].ticks, 1_000_050_000);
    // The clock itself is, too: it is latched after the frames, and one of an hour is off by more than a test takes.
    camera.expose(&image, 3_600_000_000_000, 1.0).unwrap();
    client.set(&[(0x944, 2)]);
    let latched = u64::from(client.read(0x948).unwrap()) << 32 | u64::from(client.read(0x94c).unwrap());
    assert!(
        (3_600_180_000_000..3_660_000_000_000).contains(&latched),
        "{latched}"
    );
    camera.set_faults(Faults {
        silent: true,
        ..Faults::default()
    });
    let discovery = [0x42, 1, 0, 2, 0, 0, 0, 1];
    assert_eq!(camera.hear(client.address(), &discovery), None);
    camera.set_faults(Faults::default());
    assert!(camera.hear(client.address(), &discovery).is_some());
}

#[test]
fn left_alone_the_camera_sends_test_images() {
    let (camera, mut client) = armed(settings());
    client.set(&[(TRIGGER + 4, 0)]);
    for id in 1..=3_u64 {
        client.set(&[(TRIGGER + 12, 1)]);
        let block = client.block(false);
        assert_eq!((block.id, block.payload.len()), (id, 240));
        assert_eq!(block.payload[..8], id.to_le_bytes());
        assert!(block.payload[8..].iter().any(|&byte| byte != block.payload[8]));
    }
    // In its own time, now.
    client.set(&[(ACQUISITION, 0), (TRIGGER, 0), (0x1_0028, 1), (ACQUISITION, 1)]);
    let blocks: Vec<Block> = (0..5).map(|_| client.block(false)).collect();
    assert!(
        blocks
            .windows(2)
            .all(|pair| pair[1].id == pair[0].id + 1 && pair[1].ticks > pair[0].ticks)
    );
    client.set(&[(ACQUISITION, 0)]);
    let image = vec![0; 240];
    assert_eq!(
        camera.expose(&image, 0, 1.0).unwrap(),
        Sent::Idle(Idle::NotAcquiring)
    );
}
