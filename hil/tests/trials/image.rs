//! The linked images: would a Pico boot them, and do they fit?

use std::path::Path;

use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::figures::Limit;
use rcg_hil::image::Image;
use rcg_hil::places;
use rcg_protocol::{Chip, Reset};

use crate::runs::Result;

crate::trials!("image":
    a_pico_would_boot_it [Emulator],
    it_fits [Emulator],
    it_says_who_it_is [Emulator],
);

const BOOT2: u64 = 0x1000_0000;
const VECTORS: u64 = 0x1000_0100;
const FLASH: std::ops::Range<u64> = 0x1000_0000..0x1020_0000;
const RAM: std::ops::RangeInclusive<u64> = 0x2000_0000..=0x2004_2000;

fn image(bench: &Bench) -> Result<Image> {
    Ok(Image::read(&bench.image().ok_or("a board has no image")?)?)
}

fn ensure(holds: bool, law: String) -> Outcome {
    if holds { Ok(()) } else { Err(law.into()) }
}

fn a_pico_would_boot_it(bench: &mut Bench) -> Outcome {
    let image = image(bench)?;
    // The boot ROM runs the second-stage boot loader only if its last word is the CRC-32 (MPEG-2 form) of the 252
    // bytes before it (RP2040 data sheet, 2.8.1.3.1).
    let boot2 = image.flash(BOOT2, 256);
    let Some((code, crc)) = boot2.split_last_chunk::<4>() else {
        return Err(format!("no boot loader at {BOOT2:#x}").into());
    };
    let computed = code.iter().fold(0xffff_ffff_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte) << 24, |crc, _| {
            if crc & 0x8000_0000 == 0 {
                crc << 1
            } else {
                crc << 1 ^ 0x04c1_1db7
            }
        })
    });
    ensure(
        code.len() == 252 && computed.to_le_bytes() == *crc,
        format!("the boot loader of {} bytes has a wrong CRC", code.len()),
    )?;
    let vectors = image.flash(VECTORS, 8);
    let word = |at: usize| -> Result<u64> {
        let bytes = vectors.get(at..at + 4).ok_or("no vector table")?;
        Ok(u64::from(u32::from_le_bytes(bytes.try_into()?)))
    };
    let (stack, reset) = (word(0)?, word(4)?);
    ensure(RAM.contains(&stack), format!("initial stack pointer {stack:#x}"))?;
    ensure(
        reset & 1 == 1 && FLASH.contains(&reset) && image.entry() & !1 == reset & !1,
        format!("reset vector {reset:#x}, entry point {:#x}", image.entry()),
    )
}

fn it_fits(bench: &mut Bench) -> Outcome {
    // Of 256 kB and of 512 kB 32 are left for the stack, which has been seen to take 18.
    sizes(bench, &image(bench)?, ["flash", "RAM but for the stack"], 224)?;
    // Built from the same sources for the other chip, if it was built.
    let path = places::target().join("thumbv8m.main-none-eabihf/firmware/rcg-firmware");
    if Path::is_file(&path) {
        sizes(
            bench,
            &Image::read(&path)?,
            ["flash, RP2350", "RAM but for the stack, RP2350"],
            480,
        )?;
    }
    Ok(())
}

fn sizes(bench: &Bench, image: &Image, [flash, ram]: [&str; 2], most_ram_kib: u32) -> Outcome {
    let bytes = image.flash_bytes();
    ensure(bytes > 8 * 1024, format!("an image of {bytes} bytes is empty"))?;
    bench.figure(flash, bytes, "bytes", Limit::AtMost(1024.0 * 1024.0))?;
    // Code is in RAM too.
    bench.figure(
        ram,
        image.ram_bytes(),
        "bytes",
        Limit::AtMost(f64::from(most_ram_kib) * 1024.0),
    )
}

/// The number of its flash, the chip, and that nothing went wrong before.
fn it_says_who_it_is(bench: &mut Bench) -> Outcome {
    /// As the emulated flash was made with it.
    const SERIAL: u64 = 0xe661_a4d4_1770_a001;
    let unit = bench.device.unit()?.ok_or("it is too old to say")?;
    let found = (unit.serial, unit.chip, unit.reset);
    ensure(
        found == (SERIAL, Chip::Rp2040, Reset::PowerOn),
        format!("expected serial number {SERIAL:x}, found {unit:x?}"),
    )
}
