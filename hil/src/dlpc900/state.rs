//! What commands do.

use rcg::plan::pattern::BitPattern;

use super::pixels::{self, Bad, Image};
use super::stream::Command;
use super::{Nature, Sequence, Shown};

/// Error codes (DLPU018J, 2.1.6).
const NO_COMMAND: u8 = 3;
const NOT_FIT: u8 = 4;
const NOT_NOW: u8 = 5;
const PARAMETER: u8 = 6;
const NOT_THERE: u8 = 7;
const MEMORY: u8 = 8;
const COMPRESSION: u8 = 9;
const BIT: u8 = 10;
const NO_IMAGE: u8 = 11;
const DELAY: u8 = 13;
const EXPOSURE: u8 = 14;
const NUMBER: u8 = 15;
const PATTERN: u8 = 16;

/// Images that fit.
const IMAGES: usize = 18;
/// Entries of the table, of which DLP5500 have more.
const ENTRIES: usize = 400;
const ENTRIES_5500: usize = 960;
/// So often the mode that was is read after it was changed.
const SLOW: usize = 2;

/// An entry of the look-up table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Entry {
    exposure_us: u32,
    dark_us: u32,
    clears: bool,
    depth: u32,
    light: u8,
    waits: bool,
    image: usize,
    plane: u32,
}

/// An upload that has begun.
#[derive(Debug)]
struct Loading {
    secondary: bool,
    image: usize,
    length: usize,
    bytes: Vec<u8>,
}

/// What a unit remembers.
#[expect(clippy::struct_excessive_bools, reason = "each is a state of its own")]
#[derive(Debug)]
pub(super) struct State {
    nature: Nature,
    mode: u8,
    /// The mode before, and how often it is still read.
    leaving: (u8, usize),
    running: bool,
    has_just_started: bool,
    /// Stopped since the start, and since the last change of mode.
    stopped: bool,
    table: Vec<Option<Entry>>,
    /// The table that counts.
    effective: Vec<Entry>,
    /// Whether the table was made effective after the last upload.
    confirmed: bool,
    images: [Vec<Option<Image>>; 2],
    loading: Option<Loading>,
    /// Number of the last image of each controller.
    before: [Option<usize>; 2],
    delay_us: u16,
    error: u8,
    pub(super) heard: Vec<u16>,
    pub(super) complaints: Vec<String>,
}

/// The data of an answer, or an error code.
type Answer = Result<Vec<u8>, u8>;

fn long(bytes: &[u8]) -> u32 {
    bytes
        .iter()
        .rev()
        .fold(0, |value, byte| value << 8 | u32::from(*byte))
}

fn short(bytes: &[u8]) -> usize {
    long(&bytes[..2]) as usize
}

impl State {
    pub(super) fn new(nature: Nature) -> Self {
        Self {
            mode: 1,
            leaving: (1, 0),
            running: true,
            has_just_started: false,
            stopped: false,
            table: vec![
                None;
                if nature.mirrors == 5 {
                    ENTRIES_5500
                } else {
                    ENTRIES
                }
            ],
            nature,
            effective: Vec::new(),
            confirmed: false,
            images: [const { Vec::new() }; 2],
            loading: None,
            before: [None; 2],
            delay_us: 105,
            error: 0,
            heard: Vec::new(),
            complaints: Vec::new(),
        }
    }

    /// Whether a sequence has started since this was asked before.
    pub(super) const fn has_just_started(&mut self) -> bool {
        std::mem::replace(&mut self.has_just_started, false)
    }

    /// How many patterns the running sequence has.
    pub(super) fn running(&self) -> Option<usize> {
        (self.running && self.mode == 3).then_some(self.effective.len())
    }

    /// Number of the command that is answered late.
    pub(super) const fn late(&self) -> usize {
        self.nature.late
    }

    pub(super) fn period_us(&self) -> u32 {
        let longest = self
            .effective
            .iter()
            .map(|entry| entry.exposure_us + entry.dark_us)
            .max();
        longest.unwrap_or(0) + u32::from(self.delay_us)
    }

    /// What the unit answers; nothing where it is silent.
    pub(super) fn answer(&mut self, command: &Command) -> Option<Answer> {
        self.heard.push(command.number);
        if self.nature.silent > 0 {
            self.nature.silent -= 1;
            return None;
        }
        let answer = match self.nature.refuses {
            Some((number, error)) if number == command.number => Err(error),
            _ if command.reads() => self.read(command),
            _ => self.write(command.number, &command.data),
        };
        if command.number != 0x0100 {
            self.error = answer.as_ref().err().copied().unwrap_or(0);
        }
        if let Err(error) = answer {
            self.complaints
                .push(format!("{:04X}: error {error}", command.number));
        }
        Some(answer)
    }

    fn read(&mut self, command: &Command) -> Answer {
        if !command.data.is_empty() || !command.wants_answer() {
            return Err(PARAMETER);
        }
        let (size_is_dual, nature) = (self.nature.size_px().1, &self.nature);
        Ok(match command.number {
            0x0100 => vec![self.error],
            0x0205 => {
                let (major, minor, patch) = nature.firmware;
                let [low, high] = patch.to_le_bytes();
                [
                    [low, high, minor, major],
                    [0, 0, 0, 2],
                    [1, 0, 0, 3],
                    [2, 0, 1, 4],
                ]
                .concat()
            }
            0x0206 => {
                let mut tag = vec![nature.mirrors];
                tag.extend(b"EMULATED");
                tag.resize(32, 0);
                tag
            }
            0x1A0A => {
                let aborted = u8::from(nature.aborted > 0) << 6;
                vec![1 | u8::from(size_is_dual) << 4 | aborted]
            }
            0x1A0B => vec![1],
            0x1A0C => vec![u8::from(self.running) << 1 | u8::from(nature.has_source) << 3],
            0x1A1B => {
                if self.leaving.1 > 0 {
                    self.leaving.1 -= 1;
                    vec![self.leaving.0]
                } else {
                    vec![self.mode]
                }
            }
            _ => return Err(NO_COMMAND),
        })
    }

    fn write(&mut self, number: u16, data: &[u8]) -> Answer {
        let lengths = match number {
            0x1A1B | 0x1A24 | 0x1A36 => 1..=1,
            0x1A35 => 3..=3,
            0x1A1D => 5..=5,
            0x1A31 | 0x1A2A | 0x1A2C => 6..=6,
            0x1A34 => 12..=12,
            0x1A2B | 0x1A2D => 3..=506,
            _ => return Err(NO_COMMAND),
        };
        if !lengths.contains(&data.len()) {
            return Err(PARAMETER);
        }
        match number {
            0x1A1B => self.set_mode(data[0]),
            0x1A24 => self.play(data[0]),
            0x1A34 => self.define(data),
            0x1A31 => self.configure(data),
            0x1A2A | 0x1A2C => self.announce(number == 0x1A2C, data),
            0x1A2B | 0x1A2D => self.load(number == 0x1A2D, data),
            0x1A35 => {
                self.delay_us = short(data) as u16;
                check(self.delay_us >= 104, DELAY)?;
                check(data[2] <= 1, PARAMETER)
            }
            0x1A1D => {
                let late = |at: usize| i16::from_le_bytes([data[at], data[at + 1]]);
                check(
                    [late(1), late(3)].iter().all(|us| (-20..=20_000).contains(us)),
                    DELAY,
                )
            }
            // TRIG_IN_2.
            _ => check(data[0] <= 1, PARAMETER),
        }
    }

    fn set_mode(&mut self, mode: u8) -> Answer {
        check(mode <= 3, PARAMETER)?;
        // A unit that is not stopped hangs.
        check(self.stopped && !self.running, NOT_NOW)?;
        check(mode != 2 || self.mode == 0 && self.nature.has_source, NOT_NOW)?;
        if mode == 0 && (1..=100).contains(&self.nature.aborted) {
            self.nature.aborted -= 1;
        }
        self.leaving = (self.mode, SLOW);
        self.mode = mode;
        self.stopped = false;
        self.table.fill(None);
        self.effective.clear();
        self.forget_images();
        Ok(Vec::new())
    }

    fn forget_images(&mut self) {
        self.images = [vec![None; IMAGES], vec![None; IMAGES]];
        self.before = [None; 2];
        self.loading = None;
        self.confirmed = false;
    }

    fn play(&mut self, play: u8) -> Answer {
        match play {
            0 => {
                self.running = false;
                self.stopped = true;
                Ok(Vec::new())
            }
            2 => {
                check(self.stopped && !self.effective.is_empty(), NOT_NOW)?;
                // Without it the sequence is that of before the upload.
                check(self.confirmed, NOT_NOW)?;
                check(self.mode == 2 || self.has_all_images(), NO_IMAGE)?;
                self.running = true;
                self.has_just_started = self.mode == 3;
                self.stopped = false;
                Ok(Vec::new())
            }
            _ => Err(PARAMETER),
        }
    }

    fn has_all_images(&self) -> bool {
        let controllers = 1 + usize::from(self.nature.size_px().1);
        let has = |entry: &Entry| {
            let mut images = self.images[..controllers].iter();
            images.all(|images| images.get(entry.image).is_some_and(Option::is_some))
        };
        self.loading.is_none() && self.effective.iter().all(has)
    }

    fn is_set_up(&self) -> Answer {
        check(!self.running && self.stopped && self.mode >= 2, NOT_NOW)
    }

    fn define(&mut self, data: &[u8]) -> Answer {
        self.is_set_up()?;
        let (flags, place) = (data[5], short(&data[10..]));
        let entry = Entry {
            exposure_us: long(&data[2..5]),
            dark_us: long(&data[6..9]),
            clears: flags & 1 != 0,
            depth: u32::from(flags >> 1 & 7) + 1,
            light: flags >> 4 & 7,
            waits: flags & 0x80 != 0,
            image: place & 0x7FF,
            plane: (place >> 11) as u32,
        };
        let shortest = match entry.depth {
            1 => 105,
            8 => 4046,
            // Nobody needs them.
            _ => return Err(PATTERN),
        };
        check(entry.exposure_us >= shortest, EXPOSURE)?;
        check(entry.plane + entry.depth <= 24, BIT)?;
        check(entry.image < IMAGES, PATTERN)?;
        check(entry.light != 0 && data[9] & 0xFE == 0, PARAMETER)?;
        let place = self.table.get_mut(short(data)).ok_or(NUMBER)?;
        *place = Some(entry);
        self.confirmed = false;
        Ok(Vec::new())
    }

    fn configure(&mut self, data: &[u8]) -> Answer {
        self.is_set_up()?;
        let entries = short(data);
        check((1..=self.table.len()).contains(&entries), NUMBER)?;
        check(long(&data[2..6]) == 0, PARAMETER)?;
        let table: Option<Vec<Entry>> = self.table[..entries].iter().copied().collect();
        let table = table.ok_or(PATTERN)?;
        if table != self.effective {
            // Another table wants its images anew.
            self.effective = table;
            self.forget_images();
        }
        self.confirmed = self.mode == 2 || self.has_all_images();
        Ok(Vec::new())
    }

    fn announce(&mut self, secondary: bool, data: &[u8]) -> Answer {
        self.is_set_up()?;
        check(
            self.mode == 3 && !self.effective.is_empty() && self.loading.is_none(),
            NOT_NOW,
        )?;
        check(!secondary || self.nature.size_px().1, NOT_THERE)?;
        let (image, length) = (short(data), long(&data[2..6]) as usize);
        check(image < IMAGES && length > pixels::HEADER, PARAMETER)?;
        let last = self.effective.iter().map(|entry| entry.image).max();
        let expected = match self.before[usize::from(secondary)] {
            Some(before) => before.checked_sub(1),
            None => last,
        };
        check(expected == Some(image), PARAMETER)?;
        self.loading = Some(Loading {
            secondary,
            image,
            length,
            bytes: Vec::new(),
        });
        self.confirmed = false;
        Ok(Vec::new())
    }

    fn load(&mut self, secondary: bool, data: &[u8]) -> Answer {
        self.is_set_up()?;
        check(short(data) == data.len() - 2, PARAMETER)?;
        let mut loading = self.loading.take().ok_or(NOT_THERE)?;
        check(loading.secondary == secondary, NOT_THERE)?;
        // All but the last are full.
        loading.bytes.extend(&data[2..]);
        let is_last = loading.bytes.len() == loading.length;
        check(is_last || data.len() == 506, PARAMETER)?;
        check(loading.bytes.len() <= loading.length, MEMORY)?;
        if !is_last {
            self.loading = Some(loading);
            return Ok(Vec::new());
        }
        let image = pixels::image(&loading.bytes).map_err(|bad| match bad {
            Bad::Compression => COMPRESSION,
            Bad::Header | Bad::Pixels => PARAMETER,
        })?;
        let ((width, height), is_dual) = self.nature.size_px();
        let columns = if is_dual { width / 2 } else { width };
        check(image.size == (columns, height), NOT_FIT)?;
        self.images[usize::from(secondary)][loading.image] = Some(image);
        self.before[usize::from(secondary)] = Some(loading.image);
        Ok(Vec::new())
    }

    /// What is shown from one trigger to the next.
    pub(super) fn sequence(&self) -> Option<Sequence> {
        self.running()?;
        let shown = |entry: &Entry| Shown {
            pattern: self.pattern(entry),
            waits: entry.waits,
            // More bits than one never stay.
            holds: !entry.clears && entry.depth == 1,
            exposure_us: entry.exposure_us,
            delay_us: self.delay_us,
        };
        Some(self.effective.iter().map(shown).collect())
    }

    fn pattern(&self, entry: &Entry) -> BitPattern {
        let ((width, height), is_dual) = self.nature.size_px();
        let mut pattern = BitPattern::black(width, height);
        let (mut lit, mut level) = (Vec::new(), None);
        let columns = if is_dual { width / 2 } else { width };
        let halves = if is_dual { 2 } else { 1 };
        for (half, images) in self.images[..halves].iter().enumerate() {
            let image = images[entry.image]
                .as_ref()
                .expect("invariant: a sequence has its images");
            for (at, pixel) in image.pixels.iter().enumerate() {
                let value = pixel >> entry.plane & ((1 << entry.depth) - 1);
                if value != 0 {
                    lit.push((at / columns * width + half * columns + at % columns) as u32);
                    assert_eq!(*level.get_or_insert(value), value, "two levels in a pattern");
                }
            }
        }
        pattern.light(&lit);
        if let Some(level) = level {
            pattern.set_level(if entry.depth == 1 { u8::MAX } else { level as u8 });
            // White has all lights.
            pattern.set_primary((entry.light != 7).then(|| entry.light.trailing_zeros() as u8));
        }
        pattern
    }
}

/// `error` unless it `holds`.
fn check(holds: bool, error: u8) -> Answer {
    if holds { Ok(Vec::new()) } else { Err(error) }
}
