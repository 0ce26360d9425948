//! The polarity that is kept over resets, as words in flash: two of the lines that there always were, and behind them two of the
//! further ones, which no box of before has written.

use rcg_protocol::{AuxPolarity, Polarity};

/// What is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    /// Of PROJ, CAM, SYNC and STROBE.
    pub lines: Polarity,
    /// Of the further lines.
    pub aux: AuxPolarity,
}

/// What tells a word of each kind from others; the polarity is in the lowest bits.
const MARK: u32 = 0x5243_4750;
const AUX_MARK: u32 = 0x5243_4640;

/// `kept` as two pairs of words, in each of which either is the other one inverted.
#[must_use]
pub const fn words(kept: Kept) -> [u32; 4] {
    let Kept { lines, aux } = kept;
    let word = MARK
        | bits([
            lines.proj_active_low,
            lines.cam_active_low,
            lines.sync_active_low,
            lines.strobe_active_low,
        ]);
    let further = AUX_MARK
        | bits([
            aux.a_active_low,
            aux.b_active_low,
            aux.photo_active_low,
            aux.start_active_low,
        ]);
    [word, !word, further, !further]
}

/// What these words keep; lines rest low of which they are none of [`words`].
#[must_use]
pub const fn kept(words: [u32; 4]) -> Kept {
    let [word, inverted, further, further_inverted] = words;
    let [proj, cam, sync, strobe] = marked(MARK, word, inverted);
    let [a, b, photo, start] = marked(AUX_MARK, further, further_inverted);
    Kept {
        lines: Polarity {
            proj_active_low: proj,
            cam_active_low: cam,
            sync_active_low: sync,
            strobe_active_low: strobe,
        },
        aux: AuxPolarity {
            a_active_low: a,
            b_active_low: b,
            photo_active_low: photo,
            start_active_low: start,
        },
    }
}

/// Four lines as bits, the first one lowest.
const fn bits(lines: [bool; 4]) -> u32 {
    let [a, b, c, d] = lines;
    a as u32 | (b as u32) << 1 | (c as u32) << 2 | (d as u32) << 3
}

/// The four lines of `word`, if that has `mark` and is `inverted` behind it; else none.
const fn marked(mark: u32, word: u32, inverted: u32) -> [bool; 4] {
    let word = if word == !inverted && word & !15 == mark {
        word
    } else {
        0
    };
    [word & 1 != 0, word & 2 != 0, word & 4 != 0, word & 8 != 0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_read_back_and_nothing_else_is() {
        for bits in 0..256_u32 {
            let (low, high) = (bits & 15, bits >> 4);
            let all = [MARK | low, !(MARK | low), AUX_MARK | high, !(AUX_MARK | high)];
            let both = kept(all);
            assert_eq!((words(both), both.aux.b_active_low), (all, high & 2 != 0));
            // A box of before wrote two words only.
            let [word, inverted, ..] = all;
            let older = kept([word, inverted, u32::MAX, u32::MAX]);
            assert_eq!((older.lines, older.aux), (both.lines, AuxPolarity::default()));
            for (flipped, bit) in (0..4).flat_map(|flipped| (0..32).map(move |bit| (flipped, bit))) {
                let mut words = all;
                words[flipped] ^= 1 << bit;
                let found = kept(words);
                if flipped < 2 {
                    assert_eq!((found.lines, found.aux), (Polarity::default(), both.aux));
                } else {
                    assert_eq!((found.lines, found.aux), (both.lines, AuxPolarity::default()));
                }
            }
            assert_eq!(kept([all[2], all[3], all[0], all[1]]), Kept::default());
        }
        for nothing in [[u32::MAX; 4], [0; 4], [0, u32::MAX, 0, u32::MAX]] {
            assert_eq!(kept(nothing), Kept::default());
        }
    }
}
