//! Law: the box is back with what was written, or it is said what became of it; no drive but the box's own is written to.

use std::io::{Read as _, Write as _};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use std::{fs, thread};

use rcg_firmware::uf2::{About, MARK, Uf2};
use rcg_protocol::{
    Chip, Command, Decoder, Fault, Identity, Info, MAX_FRAME, Reply, Request, Reset, Response, SPOKEN,
    SessionId, State, Status, Ticks, ToDevice, ToHost, Unit, encode,
};
use serialport::{SerialPort as _, TTYPort};

use super::{Place, UpdateError, Updated, update};

const OLD: About = About {
    version: (0, 1, 0),
    commit: 0x1111_aaaa,
    modified: false,
};
const NEW: About = About {
    version: (0, 2, 0),
    commit: 0x2222_bbbb,
    modified: true,
};
const RP2040: &str = "UF2 Bootloader v3.0\r\nModel: Raspberry Pi RP2\r\nBoard-ID: RPI-RP2\r\n";
const RP2350: &str = "UF2 Bootloader v1.0\r\nModel: Raspberry Pi RP2350\r\nBoard-ID: RP2350\r\n";

fn file(about: About, chip: Chip) -> Uf2 {
    let (major, minor, patch) = about.version;
    let changed = if about.modified { "yes" } else { "" };
    let words = format!("{MARK}{major}.{minor}.{patch} {:08x} {changed};", about.commit);
    Uf2::check(Uf2::of_image(&[&[0; 300], words.as_bytes()].concat(), chip)).unwrap()
}

/// A box that leaves for its boot loader and comes back.
#[derive(Clone, Copy)]
struct Fake {
    /// Version of the protocol that it speaks.
    speaks: u16,
    running: bool,
    /// What its boot loader says of itself; nothing if it does not appear.
    info: Option<&'static str>,
    /// Whether it starts what was written, else what it had.
    takes: bool,
}

const FAKE: Fake = Fake {
    speaks: 3,
    running: false,
    info: Some(RP2040),
    takes: true,
};

impl Fake {
    fn answer(self, request: &Request, about: About) -> Option<Result<Reply, Fault>> {
        Some(match *request {
            Request::Hello { nonce } => {
                let (protocol, schema) = SPOKEN[usize::from(self.speaks) - 1];
                let session = SessionId(1);
                Ok(Reply::Identity(Identity {
                    protocol,
                    schema,
                    nonce,
                    session,
                }))
            }
            Request::Describe => Ok(Reply::Info(Info {
                firmware: about.version,
                clock_hz: 125_000_000,
                max_steps: 1,
                max_words: 1,
                shortest_free: 3,
                shortest_sync: 5,
                longest_period: Ticks(1),
            })),
            Request::Identify => Ok(Reply::Unit(Unit {
                serial: 7,
                commit: about.commit,
                modified: about.modified,
                chip: Chip::Rp2040,
                reset: Reset::PowerOn,
            })),
            Request::Boot if self.running => Err(Fault::Refused {
                command: Command::Boot,
                state: State::Running,
            }),
            Request::Boot => Ok(Reply::Status(Status::default())),
            _ => return None,
        })
    }

    /// Is at `port` with the firmware `about` until it has left for its boot loader, or `over`. Returns whether it has left.
    fn serve(self, port: &Path, about: About, over: &AtomicBool) -> bool {
        let (mut peer, held) = TTYPort::pair().expect("the system has pseudo terminals");
        peer.set_timeout(Duration::from_millis(5)).unwrap();
        symlink(held.name().expect("it has a name"), port).unwrap();
        let (mut decoder, mut bytes, mut leaves) = (Decoder::new(), [0; 256], false);
        while !leaves && !over.load(Ordering::Relaxed) {
            let count = peer.read(&mut bytes).unwrap_or(0);
            for &byte in &bytes[..count] {
                let Some(Ok(asked)) = decoder.push::<ToDevice>(byte) else {
                    continue;
                };
                let Some(result) = self.answer(&asked.request, about) else {
                    continue;
                };
                leaves |= asked.request == Request::Boot && result.is_ok();
                let (session, seq) = (asked.session, asked.seq);
                let response = ToHost::Response(Response { session, seq, result });
                let mut frame = [0; MAX_FRAME];
                peer.write_all(encode(&response, &mut frame).unwrap()).unwrap();
            }
        }
        // What was answered is on its way.
        thread::sleep(Duration::from_millis(20));
        fs::remove_file(port).unwrap();
        leaves
    }

    /// Is there, and again after each update.
    fn live(self, port: &Path, drive: &Path, over: &AtomicBool) {
        let mut about = OLD;
        while self.serve(port, about, over) {
            if let Some(info) = self.info {
                about = self.boot_loader(drive, info, over).unwrap_or(about);
            }
        }
    }

    /// Waits for a file on the drive; returns what is started then.
    fn boot_loader(self, drive: &Path, info: &str, over: &AtomicBool) -> Option<About> {
        fs::create_dir_all(drive).unwrap();
        fs::write(drive.join("INFO_UF2.TXT"), info).unwrap();
        let written = loop {
            let bytes = fs::read(drive.join("rcg-firmware.uf2")).unwrap_or_default();
            match Uf2::check(bytes) {
                Ok(uf2) => break uf2,
                Err(_) if over.load(Ordering::Relaxed) => return None,
                Err(_) => thread::sleep(Duration::from_millis(5)),
            }
        };
        fs::remove_dir_all(drive).unwrap();
        self.takes.then(|| written.about())
    }
}

struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Updates `fake` from [`OLD`] to `uf2`. `drive_before` says what is on a drive that was there before. Returns what came of it and the
/// files that are left on the drive.
fn updated(
    fake: Option<Fake>,
    uf2: &Uf2,
    drive_before: Option<&str>,
) -> (Result<Updated, UpdateError>, Vec<PathBuf>) {
    let dir = tempfile::tempdir().unwrap();
    let (port, drive) = (dir.path().join("box"), dir.path().join("drive"));
    if let Some(info) = drive_before {
        fs::create_dir(&drive).unwrap();
        fs::write(drive.join("INFO_UF2.TXT"), info).unwrap();
    }
    let over = AtomicBool::new(false);
    let result = thread::scope(|scope| {
        let _over = Over(&over);
        match fake {
            Some(fake) => {
                let (port, drive, over) = (&port, &drive, &over);
                scope.spawn(move || fake.live(port, drive, over));
                let began = Instant::now();
                while !port.exists() && began.elapsed() < Duration::from_secs(10) {
                    thread::sleep(Duration::from_millis(1));
                }
            }
            // It is in its boot loader already.
            None if drive_before.is_some() => {
                let (port, drive, over) = (&port, &drive, &over);
                scope.spawn(move || {
                    let about = FAKE.boot_loader(drive, RP2040, over);
                    about.map(|about| FAKE.serve(port, about, over))
                });
            }
            None => {}
        }
        let place = Place {
            port: port.to_str().unwrap().to_owned(),
            volume: Some(drive.clone()),
            patience: Duration::from_millis(1500),
        };
        update(uf2, &place)
    });
    let left = fs::read_dir(&drive).into_iter().flatten();
    (result, left.map(|entry| entry.unwrap().path()).collect())
}

#[test]
fn the_box_is_back_with_what_was_written() {
    let uf2 = file(NEW, Chip::Rp2040);
    let (done, left) = updated(Some(FAKE), &uf2, None);
    let done = done.unwrap();
    assert_eq!((done.before, done.after), (Some(OLD), NEW));
    assert!(left.is_empty());
    // One whose button was held needs no asking, and nobody knows what it was before.
    let (done, _) = updated(None, &uf2, Some(RP2040));
    let done = done.unwrap();
    assert_eq!((done.before, done.after), (None, NEW));
}

/// A box, what it is to get, what is on a drive before, and what is said.
type Case<'a> = (Option<Fake>, &'a Uf2, Option<&'a str>, &'a [&'a str]);

#[test]
fn what_cannot_be_is_said_and_nothing_is_written_elsewhere() {
    let uf2 = file(NEW, Chip::Rp2040);
    let other = file(NEW, Chip::Rp2350);
    let running = Fake {
        running: true,
        ..FAKE
    };
    let refusing = Fake { takes: false, ..FAKE };
    let of_v2 = Fake { speaks: 2, ..FAKE };
    let elsewhere = Fake {
        info: Some(RP2350),
        ..FAKE
    };
    let gone = Fake { info: None, ..FAKE };
    let table: [Case; 8] = [
        (
            Some(running),
            &uf2,
            None,
            &["cannot go to the boot loader while running"],
        ),
        (
            Some(refusing),
            &uf2,
            None,
            &[
                "0.2.0 of commit 2222bbbb and changes",
                "found 0.1.0 of commit 1111aaaa",
            ],
        ),
        (Some(of_v2), &uf2, None, &["found version 2", "BOOTSEL"]),
        (
            Some(elsewhere),
            &uf2,
            None,
            &["boot loader of the RP2040", "found that of the RP2350"],
        ),
        (
            Some(gone),
            &uf2,
            None,
            &["drive of the RP2040's boot loader at", "found none in 1 s"],
        ),
        (
            Some(FAKE),
            &other,
            None,
            &["the RP2040 of this trigger box", "for the RP2350"],
        ),
        (
            Some(FAKE),
            &uf2,
            Some(RP2040),
            &["no drive of a boot loader before"],
        ),
        (None, &uf2, None, &["box", "found none of that name"]),
    ];
    for (fake, uf2, before, parts) in table {
        let (result, left) = updated(fake, uf2, before);
        let sentence = result.unwrap_err().to_string();
        for part in parts {
            assert!(sentence.contains(part), "{sentence}");
        }
        let written = left.iter().any(|path| path.ends_with("rcg-firmware.uf2"));
        assert!(!written, "{sentence}");
    }
}

#[test]
fn drives_are_found_among_what_is_mounted() {
    let mounts = "proc /proc proc rw 0 0\n/dev/sda1 /media/ann/RPI-RP2 vfat rw 0 0\nx\n\
                  /dev/sdb1 /run/media/a\\040b vfat ro 0 0\n/dev/vda / ext4 rw 0 0\n";
    let expected = ["/media/ann/RPI-RP2", "/run/media/a b"].map(PathBuf::from);
    assert_eq!(super::volume::fat(mounts), expected);
}
