//! `log.txt` of a measurement: what the command said, and when.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use rcg::base::text::plain;

use crate::clock;

/// Its name.
const NAME: &str = "log.txt";
/// Lines that are kept until it is known where they belong.
const MOST_WAITING: usize = 1000;

/// The log of one run of the command. Each line is on the system's side before the next thing is done, so that nothing is lost where the
/// program is killed.
#[derive(Clone, Default)]
pub(crate) struct Log(Arc<Mutex<State>>);

#[derive(Default)]
struct State {
    /// Lines before there is a file.
    waiting: Vec<String>,
    file: Option<(PathBuf, File)>,
    /// Why nothing more is written.
    broken: Option<String>,
}

impl Log {
    /// Adds a line with the time.
    pub(crate) fn say(&self, line: &str) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let line = format!("{} {}\n", clock::now_or_real(), plain(line.trim_end()));
        if state.file.is_some() {
            state.write(&line);
        } else if state.waiting.len() < MOST_WAITING {
            state.waiting.push(line);
        }
    }

    /// Writes into the folder `dir` from now on, behind what stands there, and what was said so far. The caller has the right to write there.
    pub(crate) fn open(&self, dir: &Path) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if state.file.is_some() {
            return;
        }
        let path = dir.join(NAME);
        match OpenOptions::new().append(true).create(true).open(&path) {
            Ok(file) => {
                state.file = Some((path, file));
                let waiting = std::mem::take(&mut state.waiting).concat();
                state.write(&waiting);
            }
            Err(error) => state.broken = Some(format!("{}: {error}", path.display())),
        }
    }

    /// What went wrong, told once.
    pub(crate) fn complaint(&self) -> Option<String> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        state.broken.take()
    }
}

impl State {
    fn write(&mut self, lines: &str) {
        if let Some((path, file)) = &mut self.file
            && let Err(error) = file.write_all(lines.as_bytes())
        {
            self.broken.get_or_insert(format!("{}: {error}", path.display()));
        }
    }
}

impl Write for Log {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.say(&String::from_utf8_lossy(buffer));
        Ok(buffer.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
