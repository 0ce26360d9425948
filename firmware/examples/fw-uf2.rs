//! Builds the firmware and writes it as a UF2 file beside the image, for `rcg controller update` and for the drive of the boot loader.
//!
//! `cargo fw-uf2`: that of the RP2040; `cargo fw-uf2 rp2350`: that of the RP2350.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::{env, fs};

use object::{Object as _, ObjectSegment as _};
use rcg_firmware::uf2::{FLASH, Uf2};
use rcg_protocol::Chip;

fn main() -> ExitCode {
    let argument = env::args().nth(1);
    let (alias, target, chip) = match argument.as_deref() {
        None | Some("rp2040") => ("fw", "thumbv6m-none-eabi", Chip::Rp2040),
        Some("rp2350") => ("fw-rp2350", "thumbv8m.main-none-eabihf", Chip::Rp2350),
        Some(other) => {
            eprintln!("fw-uf2: expected nothing, rp2040 or rp2350, found {other}");
            return ExitCode::from(2);
        }
    };
    match made(alias, target, chip) {
        Ok((path, uf2)) => {
            println!("{}: {}, for the {chip}", path.display(), uf2.about());
            ExitCode::SUCCESS
        }
        Err(sentence) => {
            eprintln!("fw-uf2: {sentence}");
            ExitCode::FAILURE
        }
    }
}

/// Builds, converts and checks.
fn made(alias: &str, target: &str, chip: Chip) -> Result<(PathBuf, Uf2), String> {
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let built = Command::new(cargo).arg(alias).status();
    if !built.is_ok_and(|status| status.success()) {
        return Err(format!("`cargo {alias}` failed"));
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
    let elf = folder.join(target).join("firmware/rcg-firmware");
    let told = |path: &Path, what: &dyn std::fmt::Display| format!("{}: {what}", path.display());
    let bytes = fs::read(&elf).map_err(|error| told(&elf, &error))?;
    let image = image(&bytes).map_err(|error| told(&elf, &error))?;
    let uf2 = Uf2::check(Uf2::of_image(&image, chip)).map_err(|error| told(&elf, &error))?;
    let path = elf.with_extension("uf2");
    fs::write(&path, uf2.bytes()).map_err(|error| told(&path, &error))?;
    Ok((path, uf2))
}

/// What the ELF file `elf` puts into flash, from its start on.
fn image(elf: &[u8]) -> Result<Vec<u8>, object::Error> {
    use object::read::elf::{ElfFile32, ProgramHeader as _};
    let file = ElfFile32::<object::Endianness>::parse(elf)?;
    let mut image = Vec::new();
    for segment in file.segments() {
        // Where it is loaded to, which is not where it runs.
        let physical = segment.elf_program_header().p_paddr(file.endian());
        let data = segment.data()?;
        if data.is_empty() || !FLASH.contains(&physical) {
            continue;
        }
        let place = (physical - FLASH.start) as usize;
        image.resize(image.len().max(place + data.len()), 0);
        image[place..place + data.len()].copy_from_slice(data);
    }
    Ok(image)
}
