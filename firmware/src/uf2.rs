//! Firmware as a UF2 file: blocks of 512 bytes, each of which says where in flash its 256 bytes go.
//!
//! The format is Microsoft's (<https://github.com/microsoft/uf2>); what the RP2040's boot loader wants of it stands in its data sheet,
//! 2.8.4.2. It takes flash in sectors of 4 kB, and wants all pages of each that has one (erratum RP2040-E14).

extern crate alloc;

use alloc::vec;
use alloc::vec::Vec;
use core::fmt;
use core::ops::Range;

use rcg_protocol::Chip;

/// Bytes of a block.
pub const BLOCK: usize = 512;
/// Bytes of flash that a block carries.
pub const PAGE: usize = 256;
/// Bytes that are erased together.
pub const SECTOR: usize = 4096;
/// Where flash lies. An image begins at its start, and leaves the last sector to what is kept over resets.
pub const FLASH: Range<u32> = 0x1000_0000..0x101f_f000;

const MAGIC: [u32; 2] = [0x0a32_4655, 0x9e5d_5157];
const MAGIC_END: u32 = 0x0ab1_6f30;
/// The family stands where else the size of a file would.
const HAS_FAMILY: u32 = 0x2000;
/// The block is not for flash.
const NOT_FOR_FLASH: u32 = 0x1;

/// Chips with the numbers of their families.
const FAMILIES: [(Chip, u32); 2] = [(Chip::Rp2040, 0xe48b_ff56), (Chip::Rp2350, 0xe48b_ff59)];

/// What stands in an image before the words that say which it is; see [`About`].
pub const MARK: &str = "RCG trigger box, firmware ";

/// Which firmware an image is, as it says itself behind [`MARK`]: version, commit and whether that was changed, with blanks between
/// them and a semicolon behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct About {
    /// Major, minor, patch.
    pub version: (u8, u8, u8),
    /// The first 32 bits of the commit; 0 if that is not known.
    pub commit: u32,
    /// Whether what it was built from was another than that commit.
    pub modified: bool,
}

impl About {
    /// What the first words behind a [`MARK`] in `image` say.
    fn of(image: &[u8]) -> Option<Self> {
        let marks = image.windows(MARK.len()).enumerate();
        let places = marks.filter(|(_, bytes)| *bytes == MARK.as_bytes());
        let mut found = places.filter_map(|(place, _)| Self::parse(&image[place + MARK.len()..]));
        found.next()
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        let end = bytes.iter().take(64).position(|&byte| byte == b';')?;
        let mut words = core::str::from_utf8(&bytes[..end]).ok()?.split(' ');
        let mut numbers = words.next()?.split('.').map(str::parse);
        let mut number = || numbers.next()?.ok();
        let version = (number()?, number()?, number()?);
        let commit = u32::from_str_radix(words.next()?, 16).ok()?;
        let modified = words.next().is_some_and(|word| !word.is_empty());
        Some(Self {
            version,
            commit,
            modified,
        })
    }
}

impl fmt::Display for About {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            version: (major, minor, patch),
            commit,
            modified,
        } = self;
        let changes = if *modified { " and changes" } else { "" };
        write!(f, "{major}.{minor}.{patch} of commit {commit:08x}{changes}")
    }
}

/// Why a file is no firmware of the trigger box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Uf2Error {
    /// It is no row of whole blocks.
    Length(usize),
    /// A block has not the marks of one.
    NoBlock(usize),
    /// A block is for another chip.
    Family(u32),
    /// A block does not carry one page for flash.
    NoPage(usize),
    /// A block is for a place outside of flash, or not for the start of a page.
    Address(u32),
    /// The blocks do not say of themselves that there are so many.
    Count {
        /// What a block says.
        said: u32,
        /// Blocks that are there.
        found: usize,
    },
    /// A block is there twice, or another has its place.
    Twice(u32),
    /// No block carries this page.
    Gap(u32),
    /// It does not say that it is the trigger box's.
    Stranger,
}

impl fmt::Display for Uf2Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length(length) => write!(
                f,
                "expected a UF2 file of whole blocks of {BLOCK} bytes, found {length} bytes"
            ),
            Self::NoBlock(block) => write!(
                f,
                "block {block}: expected the marks of a UF2 block, found none: it is no UF2 file, or a damaged one"
            ),
            Self::Family(family) => write!(
                f,
                "family: expected that of the RP2040 (0xe48bff56) or of the RP2350 (0xe48bff59) in all blocks, found {family:#010x}"
            ),
            Self::NoPage(block) => write!(
                f,
                "block {block}: expected {PAGE} bytes for flash and the number of a family, found none"
            ),
            Self::Address(address) => write!(
                f,
                "address {address:#010x}: expected the start of a page of flash below {:#010x}",
                FLASH.end
            ),
            Self::Count { said, found } => {
                write!(
                    f,
                    "expected {said} blocks, as they say, found {found}: it is not whole"
                )
            }
            Self::Twice(block) => write!(f, "block {block}: expected once, found twice"),
            Self::Gap(address) => write!(f, "address {address:#010x}: expected a block for it, found none"),
            Self::Stranger => f.write_str(
                "expected firmware that says that it is the RCG trigger box's, found another program",
            ),
        }
    }
}

impl core::error::Error for Uf2Error {}

/// A UF2 file with firmware of the trigger box.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Uf2 {
    bytes: Vec<u8>,
    chip: Chip,
    about: About,
}

impl Uf2 {
    /// Checks the content of a file: that every block is one of this chip's, that none is missing or there twice, that they fill flash
    /// from its start without a gap, and that the image is the trigger box's.
    ///
    /// # Errors
    /// [`Uf2Error`], the first that there is.
    pub fn check(bytes: Vec<u8>) -> Result<Self, Uf2Error> {
        let count = bytes.len() / BLOCK;
        if count == 0 || !bytes.len().is_multiple_of(BLOCK) {
            return Err(Uf2Error::Length(bytes.len()));
        }
        let mut chip = None;
        let mut seen = vec![false; count];
        let mut image = vec![None; (FLASH.end - FLASH.start) as usize / PAGE];
        for (place, block) in bytes.chunks_exact(BLOCK).enumerate() {
            let word = |at: usize| u32::from_le_bytes(block[at..at + 4].try_into().expect("four bytes"));
            if [word(0), word(4)] != MAGIC || word(BLOCK - 4) != MAGIC_END {
                return Err(Uf2Error::NoBlock(place));
            }
            let (flags, address, length) = (word(8), word(12), word(16));
            let (number, said, family) = (word(20), word(24), word(28));
            if flags & HAS_FAMILY == 0 || flags & NOT_FOR_FLASH != 0 || length as usize != PAGE {
                return Err(Uf2Error::NoPage(place));
            }
            let of = FAMILIES
                .iter()
                .find(|(_, its)| *its == family)
                .map(|(chip, _)| *chip);
            if of.is_none() || chip.is_some_and(|chip| Some(chip) != of) {
                return Err(Uf2Error::Family(family));
            }
            chip = of;
            if said as usize != count {
                return Err(Uf2Error::Count { said, found: count });
            }
            if number as usize >= count || core::mem::replace(&mut seen[number as usize], true) {
                return Err(Uf2Error::Twice(number));
            }
            if !FLASH.contains(&address) || !(address as usize).is_multiple_of(PAGE) {
                return Err(Uf2Error::Address(address));
            }
            let page = (address - FLASH.start) as usize / PAGE;
            if image[page].replace(&block[32..32 + PAGE]).is_some() {
                return Err(Uf2Error::Twice(number));
            }
        }
        let pages: Vec<&[u8]> = image.iter().map_while(|page| *page).collect();
        if pages.len() != count {
            return Err(Uf2Error::Gap(FLASH.start + (pages.len() * PAGE) as u32));
        }
        let about = About::of(&pages.concat()).ok_or(Uf2Error::Stranger)?;
        let chip = chip.expect("there is a block");
        Ok(Self { bytes, chip, about })
    }

    /// Makes a file of an image for `chip` that stands at the start of flash; filled up with zeros to whole sectors.
    ///
    /// # Panics
    /// Where there is no such chip to be flashed, as with a simulated one.
    #[must_use]
    pub fn of_image(image: &[u8], chip: Chip) -> Vec<u8> {
        let (_, family) = FAMILIES
            .into_iter()
            .find(|(its, _)| *its == chip)
            .expect("a chip that has a flash");
        let mut image = image.to_vec();
        image.resize(image.len().next_multiple_of(SECTOR), 0);
        let count = (image.len() / PAGE) as u32;
        let mut bytes = Vec::with_capacity(count as usize * BLOCK);
        for (number, page) in (0..).zip(image.chunks_exact(PAGE)) {
            let address = FLASH.start + number * PAGE as u32;
            let head = [
                MAGIC[0],
                MAGIC[1],
                HAS_FAMILY,
                address,
                PAGE as u32,
                number,
                count,
                family,
            ];
            bytes.extend(head.into_iter().flat_map(u32::to_le_bytes));
            bytes.extend_from_slice(page);
            bytes.resize(bytes.len().next_multiple_of(BLOCK) - 4, 0);
            bytes.extend(MAGIC_END.to_le_bytes());
        }
        bytes
    }

    /// The file.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// What it is for.
    #[must_use]
    pub const fn chip(&self) -> Chip {
        self.chip
    }

    /// Which firmware it is.
    #[must_use]
    pub const fn about(&self) -> About {
        self.about
    }
}
