//! What no driver may do, command by command.

use rcg::capture::dlpc900::image::Planes;
use rcg::capture::dlpc900::packet::{CommandError, Commands};
use rcg::plan::pattern::BitPattern;

use super::unit;

/// What the words of the cases below are as commands.
fn told(word: &str) -> Vec<(u16, Vec<u8>)> {
    let entry = |exposure: u32, depth: u8, image: u8, plane: u8| {
        let [low, high, ..] = exposure.to_le_bytes();
        let flags = 0x80 | 0x70 | (depth - 1) << 1;
        vec![(
            0x1A34,
            vec![0, 0, low, high, 0, flags, 0, 0, 0, 0, image, plane << 3],
        )]
    };
    let mut black = BitPattern::black(1024, 768);
    black.light(&[3]);
    let image = Planes::of(&[black], 1).upload((0, 1024));
    let announce = |image: u8, length: usize| {
        let [low, high, ..] = (length as u32).to_le_bytes();
        vec![(0x1A2A, vec![image, 0, low, high, 0, 0])]
    };
    let load = |bytes: &[u8]| (0x1A2B, [&(bytes.len() as u16).to_le_bytes()[..], bytes].concat());
    match word {
        "stop" => vec![(0x1A24, vec![0])],
        "start" => vec![(0x1A24, vec![2])],
        "mode" => vec![(0x1A1B, vec![3])],
        "table" => entry(105, 1, 0, 0),
        "second-image" => entry(105, 1, 1, 0),
        "104" => entry(104, 1, 0, 0),
        "4045" => entry(4045, 8, 0, 0),
        "plane-17" => entry(4046, 8, 0, 17),
        "effective" => vec![(0x1A31, vec![1, 0, 0, 0, 0, 0])],
        "announce" => announce(0, image.len()),
        "announce-60" => announce(0, 60),
        "load" => image.chunks(504).map(load).collect(),
        "load-70" => vec![load(&image[..70])],
        "load-505" => vec![load(&[0; 505])],
        "count" => vec![(0x1A2B, [load(&image[..99]).1, vec![0]].concat())],
        "delay-103" => vec![(0x1A35, vec![103, 0, 0])],
        "late-21" => vec![(0x1A1D, vec![0, 0xEB, 0xFF, 0, 0])],
        "unknown" => vec![(0x1A99, vec![0])],
        _ => vec![(0x1A1B, vec![])],
    }
}

#[test]
fn the_unit_refuses_what_a_real_one_hangs_at() {
    // All but the last command are done; its error is 0 for none, 255 for no answer, as it does not fit into the buffer.
    for (script, error) in [
        ("stop mode stop table effective announce load effective start", 0),
        ("mode", 5),
        ("stop mode table", 5),
        ("stop mode stop table start", 5),
        ("stop mode stop table effective start", 5),
        ("stop mode stop table effective announce load start", 5),
        (
            "stop mode stop table effective announce load effective start table",
            5,
        ),
        (
            "stop mode stop table effective announce load effective start mode",
            5,
        ),
        ("stop mode stop table effective load-70", 7),
        ("stop mode stop table effective announce-60 load-70", 6),
        ("stop mode stop table effective announce count", 6),
        ("stop mode stop table effective announce load-505", 255),
        ("stop mode stop second-image effective announce", 6),
        ("stop mode stop 104", 14),
        ("stop mode stop 4045", 14),
        ("stop mode stop plane-17", 10),
        ("delay-103", 13),
        ("late-21", 13),
        ("unknown", 3),
        ("empty", 6),
    ] {
        let unit = unit(5);
        let mut commands = Commands::new(unit.reports());
        let all: Vec<(u16, Vec<u8>)> = script.split(' ').flat_map(told).collect();
        for (at, (command, data)) in all.iter().enumerate() {
            let said = commands.write(*command, data);
            let command = *command;
            let expected = match if at + 1 == all.len() { error } else { 0 } {
                0 => Ok(()),
                255 => Err(CommandError::Silent { command }),
                code => Err(CommandError::Refused { command, code }),
            };
            assert_eq!(said, expected, "{script}: {command:04X}");
        }
    }
}
