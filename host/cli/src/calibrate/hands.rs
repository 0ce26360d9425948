//! Somebody at the terminal, or lines on stdin in their place.

use std::io::{self, BufRead as _, IsTerminal as _, Write as _};
use std::path::Path;

use rcg::base::text::{plain, shown};
use rcg::calibrate::by_hand::{Answer, Asked, Hands, HowFar};

use crate::failure::Failure;
use crate::output::Output;

/// The heading in the help.
const BY_HAND: &str = "By hand";

/// How targets come into the holder.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct HandArgs {
    /// Ask on stderr for one target after the other, and read from stdin: Enter when it stands there, `again` to take the view before once
    /// more, `keep` to insist on one that was refused, `stop` (or end of input) to go on another day with the same command; exit code 0
    /// then too. Each view is stored when it is captured, if that target seems to stand there. On the virtual rig alone
    /// `put mirror TILT AZIMUTH`, `put lambert:0.5` (any sample) or `put nothing` puts something else in
    #[arg(long, help_heading = BY_HAND)]
    by_hand: bool,
    /// Take the views of these numbers again, by hand, and no others but those that are missing
    #[arg(long, value_name = "N,...", value_delimiter = ',', help_heading = BY_HAND)]
    redo: Vec<usize>,
}

impl HandArgs {
    /// The views to take again if targets are put in by hand.
    pub(crate) fn redo(&self) -> Option<&[usize]> {
        (self.by_hand || !self.redo.is_empty()).then_some(&self.redo)
    }
}

/// Lines of stdin.
pub(crate) struct Lines<'a> {
    pub(crate) output: &'a Output,
}

impl Hands for Lines<'_> {
    fn change(&mut self, asked: &Asked) -> Answer {
        let mut voice = io::stderr().lock();
        // Asked with --quiet too: nobody could answer else. A reader of stderr that has gone is no reason to fail.
        if let Some(complaint) = asked.complaint {
            self.output.log(complaint);
            writeln!(voice, "{}", plain(complaint)).ok();
        }
        let keep = if asked.can_keep {
            "'keep' to take it all the same, "
        } else {
            ""
        };
        let view = match asked.number {
            0 => "before the views".to_owned(),
            number => format!("view {number} of {}", asked.of),
        };
        write!(
            voice,
            "{view}: {}; put it in, then Enter ({keep}'again' to redo the last view, 'stop' to go on another day) ",
            asked.target
        )
        .ok();
        // Whoever reads lines gets whole ones.
        if !io::stdin().is_terminal() {
            writeln!(voice).ok();
        }
        voice.flush().ok();
        let mut line = String::new();
        let read = io::stdin().lock().read_line(&mut line);
        let answer = match read {
            // What is no text is no end.
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                Answer::Unknown("what is no text".to_owned())
            }
            Ok(0) | Err(_) => Answer::Stop,
            Ok(_) => answer(&line),
        };
        self.output
            .log(&format!("{view}: {}: {}", asked.target, shown(line.trim())));
        answer
    }
}

/// What a line says.
fn answer(line: &str) -> Answer {
    let line = line.trim();
    match line.split_once(char::is_whitespace).unwrap_or((line, "")) {
        ("", _) => Answer::Ready,
        ("again", "") => Answer::Again,
        ("keep", "") => Answer::Keep,
        ("stop", "") => Answer::Stop,
        ("put", what) => Answer::Put(what.trim().to_owned()),
        _ => Answer::Unknown(shown(line)),
    }
}

/// Says which views are missing, if some are, and how to go on with `command` in `dir`.
pub(crate) fn is_stopped(
    how_far: &HowFar,
    command: &str,
    dir: &Path,
    output: &Output,
) -> Result<bool, Failure> {
    if how_far.missing.is_empty() {
        return Ok(false);
    }
    output.print(how_far, || {
        let missing = how_far.missing.iter().zip(&how_far.targets);
        let missing: Vec<String> = missing.map(|(number, target)| format!("{number} ({target})")).collect();
        format!(
            "{} of {} views are missing: {}; the same command, `rcg calibrate {command} --by-hand --out {}`, goes on with them\n",
            missing.len(),
            how_far.views,
            missing.join(", "),
            dir.display()
        )
    })?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_answers_and_what_is_none_is_said() {
        assert_eq!(answer("\n"), Answer::Ready);
        assert_eq!(answer(" again \n"), Answer::Again);
        assert_eq!(answer("keep"), Answer::Keep);
        assert_eq!(answer("stop\r\n"), Answer::Stop);
        assert_eq!(
            answer("put  mirror 15 240\n"),
            Answer::Put("mirror 15 240".to_owned())
        );
        assert_eq!(answer("put"), Answer::Put(String::new()));
        for line in ["stop it", "Again", "yes", "keep 3"] {
            assert!(matches!(answer(line), Answer::Unknown(_)), "{line}");
        }
    }
}
