//! The linked firmware image: would a Pico boot it?

use std::path::PathBuf;

use object::{Object as _, ObjectSection as _, ObjectSegment as _};

const BOOT2: u64 = 0x1000_0000;
const VECTORS: u64 = 0x1000_0100;
const FLASH: std::ops::Range<u64> = 0x1000_0000..0x1020_0000;
const RAM: std::ops::RangeInclusive<u64> = 0x2000_0000..=0x2004_2000;

fn elf() -> Option<(PathBuf, Vec<u8>)> {
    let path = std::env::var_os("RCG_FIRMWARE_ELF").map_or_else(
        || {
            let target = concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../target/thumbv6m-none-eabi/firmware/rcg-firmware"
            );
            PathBuf::from(target)
        },
        PathBuf::from,
    );
    if let Ok(bytes) = std::fs::read(&path) {
        return Some((path, bytes));
    }
    println!(
        "skipped: no firmware image at {}; `cargo fw` builds it",
        path.display()
    );
    None
}

/// The bytes that would stand in flash at `at`.
fn flash_at(file: &object::File, at: u64, length: u64) -> Vec<u8> {
    file.segments()
        .find_map(|segment| segment.data_range(at, length).ok().flatten())
        .unwrap_or_default()
        .to_vec()
}

#[test]
fn a_pico_would_boot_the_image() {
    let Some((path, bytes)) = elf() else { return };
    let file = object::File::parse(&*bytes).expect("the firmware is an ELF file");

    let boot2 = flash_at(&file, BOOT2, 256);
    assert_eq!(
        boot2.len(),
        256,
        "{}: no boot loader at {BOOT2:#x}",
        path.display()
    );
    // The boot ROM runs it only if its last word is the CRC-32 (MPEG-2 form) of the 252 bytes before it
    // (RP2040 data sheet, 2.8.1.3.1).
    let crc = boot2[..252].iter().fold(0xffff_ffff_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte) << 24, |crc, _| {
            if crc & 0x8000_0000 == 0 {
                crc << 1
            } else {
                crc << 1 ^ 0x04c1_1db7
            }
        })
    });
    assert_eq!(
        crc.to_le_bytes(),
        boot2[252..],
        "{}: wrong CRC of the boot loader",
        path.display()
    );

    let vectors = flash_at(&file, VECTORS, 8);
    assert_eq!(
        vectors.len(),
        8,
        "{}: no vector table at {VECTORS:#x}",
        path.display()
    );
    let word = |at: usize| {
        u64::from(u32::from_le_bytes(
            vectors[at..at + 4].try_into().expect("four bytes"),
        ))
    };
    assert!(RAM.contains(&word(0)), "initial stack pointer {:#x}", word(0));
    assert!(
        word(4) & 1 == 1 && FLASH.contains(&word(4)),
        "reset vector {:#x}",
        word(4)
    );
    assert_eq!(file.entry() & !1, word(4) & !1, "entry point and reset vector");
}

#[test]
fn the_image_fits() {
    let Some((_, bytes)) = elf() else { return };
    let file = object::File::parse(&*bytes).expect("the firmware is an ELF file");
    let size = |names: &[&str]| -> u64 {
        file.sections()
            .filter(|s| names.contains(&s.name().unwrap_or("")))
            .map(|s| s.size())
            .sum()
    };
    let flash = size(&[".boot2", ".vector_table", ".text", ".rodata", ".data"]);
    let ram = size(&[".data", ".bss", ".uninit"]);
    println!("flash {flash} bytes, static RAM {ram} bytes");
    assert!(flash > 8 * 1024, "an image of {flash} bytes is empty");
    assert!(
        flash < 1024 * 1024 && ram < 232 * 1024,
        "flash {flash}, RAM {ram}: little is left for the stack"
    );
}
