//! The memory that schedules are kept in, for a box without a board.

extern crate alloc;

use alloc::vec::Vec;

use rcg_protocol::{FIRST_PAGE, PAGE_BYTES};

/// Flash, as far as it was written.
#[derive(Clone, Debug, Default)]
pub struct VirtualFlash {
    bytes: Vec<u8>,
}

impl From<Vec<u8>> for VirtualFlash {
    fn from(bytes: Vec<u8>) -> Self {
        Self { bytes }
    }
}

impl VirtualFlash {
    /// What is in it.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Writes `bytes`, and zeros behind them, to `page`, unless there are none. As flash does: a sector is erased with its first page, and
    /// writing makes no one of a zero.
    pub fn store(&mut self, page: u16, bytes: &[u8]) {
        let at = usize::from(page) * PAGE_BYTES;
        let sector = at..at + usize::from(FIRST_PAGE) * PAGE_BYTES;
        if self.bytes.len() < sector.end {
            self.bytes.resize(sector.end, u8::MAX);
        }
        if page.is_multiple_of(FIRST_PAGE) {
            self.bytes[sector].fill(u8::MAX);
        }
        if !bytes.is_empty() {
            let padded = bytes.iter().chain(core::iter::repeat(&0));
            let page = &mut self.bytes[at..at + PAGE_BYTES];
            page.iter_mut()
                .zip(padded)
                .for_each(|(place, byte)| *place &= byte);
        }
    }
}
