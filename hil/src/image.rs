//! The firmware's ELF file: what a Pico would boot, its size, its symbols.

use std::path::{Path, PathBuf};
use std::{fs, io};

use object::{Object as _, ObjectSection as _, ObjectSegment as _, ObjectSymbol as _};

/// Why there is no image.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file cannot be read.
    #[error("{path}: {source}; `cargo fw` builds it")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It is no ELF file.
    #[error("{path}: expected an ELF file: {source}")]
    NoElf {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: object::Error,
    },
}

/// A linked firmware image.
#[derive(Debug)]
pub struct Image {
    bytes: Vec<u8>,
}

impl Image {
    /// Reads the ELF file `path`.
    ///
    /// # Errors
    /// [`ImageError`].
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        let bytes = fs::read(path).map_err(|source| ImageError::Io {
            path: path.to_owned(),
            source,
        })?;
        object::File::parse(&*bytes).map_err(|source| ImageError::NoElf {
            path: path.to_owned(),
            source,
        })?;
        Ok(Self { bytes })
    }

    /// The file as it is.
    #[must_use]
    pub fn elf(&self) -> &[u8] {
        &self.bytes
    }

    fn file(&self) -> object::File<'_> {
        object::File::parse(&*self.bytes).expect("it was parsed when it was read")
    }

    /// The bytes that would stand in flash at `at`; empty if the image does not cover them.
    #[must_use]
    pub fn flash(&self, at: u64, length: u64) -> Vec<u8> {
        let segments = self.file();
        let mut data = segments
            .segments()
            .filter_map(|s| s.data_range(at, length).ok().flatten());
        data.next().unwrap_or_default().to_vec()
    }

    /// Where execution begins.
    #[must_use]
    pub fn entry(&self) -> u64 {
        self.file().entry()
    }

    /// Bytes in flash: code, constants and the first values of variables.
    #[must_use]
    pub fn flash_bytes(&self) -> u64 {
        self.size(&[
            ".boot2",
            ".start_block",
            ".vector_table",
            ".boot_text",
            ".text",
            ".rodata",
            ".data",
            ".ram_text",
            ".end_block",
        ])
    }

    /// Bytes of code and static variables in RAM; what is left is for the stack.
    #[must_use]
    pub fn ram_bytes(&self) -> u64 {
        self.size(&[".data", ".ram_text", ".bss", ".uninit"])
    }

    fn size(&self, names: &[&str]) -> u64 {
        let file = self.file();
        let sections = file
            .sections()
            .filter(|s| s.name().is_ok_and(|name| names.contains(&name)));
        sections.map(|section| section.size()).sum()
    }

    /// Address of the function whose mangled name contains `part`; the first of them.
    #[must_use]
    pub fn function(&self, part: &str) -> Option<u32> {
        let file = self.file();
        let mut symbols = file
            .symbols()
            .filter(|s| s.name().is_ok_and(|name| name.contains(part)));
        symbols.next().map(|symbol| symbol.address() as u32)
    }
}
