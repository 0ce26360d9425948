//! Law: a file is taken whole and as it was made, or refused by name.

use rcg_firmware::uf2::{About, BLOCK, FLASH, MARK, PAGE, SECTOR, Uf2, Uf2Error};
use rcg_protocol::Chip;

const ABOUT: About = About {
    version: (0, 12, 3),
    commit: 0x0123_abcd,
    modified: true,
};

fn image() -> Vec<u8> {
    let mut image: Vec<u8> = (0..3 * SECTOR + 700).map(|byte| (byte % 251) as u8).collect();
    // Words that are cut off are none.
    let words = [MARK, "0.1", MARK, "0.12.3 0123abcd yes;"].concat();
    image[5000..5000 + words.len()].copy_from_slice(words.as_bytes());
    image
}

fn file() -> Vec<u8> {
    Uf2::of_image(&image(), Chip::Rp2040)
}

/// A file in whose block `block` the word at byte `at` was changed.
fn with(block: usize, at: usize, value: u32) -> Vec<u8> {
    let mut file = file();
    let place = block * BLOCK + at;
    file[place..place + 4].copy_from_slice(&value.to_le_bytes());
    file
}

#[test]
fn what_was_made_is_read_back() {
    for chip in [Chip::Rp2040, Chip::Rp2350] {
        let file = Uf2::of_image(&image(), chip);
        assert_eq!(file.len(), 4 * SECTOR / PAGE * BLOCK, "whole sectors");
        let read = Uf2::check(file.clone()).unwrap();
        assert_eq!(
            (read.chip(), read.about(), read.bytes()),
            (chip, ABOUT, &file[..])
        );
        assert_eq!(read.about().to_string(), "0.12.3 of commit 0123abcd and changes");
    }
    // The first block, as Microsoft's page has it.
    let words: Vec<u32> = file()[..32]
        .chunks(4)
        .map(|word| u32::from_le_bytes(word.try_into().unwrap()))
        .collect();
    assert_eq!(
        words,
        [
            0x0a32_4655,
            0x9e5d_5157,
            0x2000,
            0x1000_0000,
            256,
            0,
            64,
            0xe48b_ff56
        ]
    );
    assert_eq!(file()[BLOCK - 4..BLOCK], [0x30, 0x6f, 0xb1, 0x0a]);
    // Blocks may come in any order.
    let turned: Vec<u8> = file().chunks(BLOCK).rev().flatten().copied().collect();
    assert_eq!(Uf2::check(turned).unwrap().about(), ABOUT);
}

#[test]
fn what_is_no_whole_firmware_of_the_box_is_refused_by_name() {
    let blocks = file().len() / BLOCK;
    let cut = |bytes: usize| file()[..bytes].to_vec();
    let stranger = Uf2::of_image(&vec![7; 9000], Chip::Rp2040);
    let mut doubled = file();
    doubled.copy_within(3 * BLOCK..4 * BLOCK, 9 * BLOCK);
    let last_sector = (FLASH.end - FLASH.start) as usize;
    let too_long = Uf2::of_image(&vec![7; last_sector + 1], Chip::Rp2040);
    for (file, expected) in [
        (Vec::new(), Uf2Error::Length(0)),
        (b"\x7fELF".repeat(128), Uf2Error::NoBlock(0)),
        (cut(1000), Uf2Error::Length(1000)),
        (
            cut(BLOCK * (blocks - 1)),
            Uf2Error::Count {
                said: blocks as u32,
                found: blocks - 1,
            },
        ),
        (with(5, 4, 0), Uf2Error::NoBlock(5)),
        (with(5, BLOCK - 4, 0), Uf2Error::NoBlock(5)),
        (with(0, 28, 0xada5_2840), Uf2Error::Family(0xada5_2840)),
        (with(7, 28, 0xe48b_ff59), Uf2Error::Family(0xe48b_ff59)),
        (with(2, 8, 0), Uf2Error::NoPage(2)),
        (with(2, 8, 0x2001), Uf2Error::NoPage(2)),
        (with(2, 16, 476), Uf2Error::NoPage(2)),
        (with(2, 20, 3), Uf2Error::Twice(3)),
        (with(2, 20, 64), Uf2Error::Twice(64)),
        (doubled, Uf2Error::Twice(3)),
        (with(4, 12, 0x1000_0300), Uf2Error::Twice(4)),
        (with(4, 12, 0x2000_0000), Uf2Error::Address(0x2000_0000)),
        (with(4, 12, FLASH.end), Uf2Error::Address(FLASH.end)),
        (with(4, 12, 0x1000_0404), Uf2Error::Address(0x1000_0404)),
        (with(63, 12, 0x1000_8000), Uf2Error::Gap(0x1000_3f00)),
        (with(0, 12, 0x1000_8000), Uf2Error::Gap(FLASH.start)),
        (too_long, Uf2Error::Address(FLASH.end)),
        (stranger, Uf2Error::Stranger),
    ] {
        let error = Uf2::check(file).unwrap_err();
        assert_eq!(error, expected);
        let sentence = error.to_string();
        assert!(
            sentence.contains("expected") && sentence.contains("found")
                || matches!(error, Uf2Error::Address(_)),
            "{sentence}"
        );
    }
}
