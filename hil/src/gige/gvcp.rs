//! GigE Vision Control Protocol: datagrams to commands, and acknowledges to datagrams.
//!
//! # Format (GigE Vision 2.x, "GVCP"; UDP port 3956, big-endian)
//! A command is `42 flags8 command16 length16 id16` and `length` bytes; flag 01 asks for an acknowledge. An
//! acknowledge is `status16 acknowledge16 length16 id16` and its bytes. A datagram is 548 B at most.
//!
//! | command | bytes | acknowledge | bytes |
//! |---|---|---|---|
//! | 0002 discovery | | 0003 | memory 0000 … 00f7 |
//! | 0040 packet resend (flag 10: 64-bit ids) | channel16 block16 first32 last32, with 64-bit ids block64 | none | packets on the stream |
//! | 0080 read registers | address32, up to 135 | 0081 | value32 each |
//! | 0082 write registers | address32 value32, up to 67 | 0083 | 0000 done16 |
//! | 0084 read memory | address32 0000 count16, up to 536 | 0085 | address32, bytes |
//! | 0086 write memory | address32, up to 536 bytes | 0087 | 0000 done16 |
//!
//! What is no command of these is refused: what does not begin with 42, silently.

/// The port of the control channel.
pub const PORT: u16 = 3956;

/// Most bytes behind the head of a datagram.
const MOST_BYTES: usize = 540;

/// Status codes that this camera answers with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub(super) enum Status {
    Success = 0x0000,
    /// Of a packet: it is sent again.
    PacketResend = 0x0100,
    NotImplemented = 0x8001,
    InvalidParameter = 0x8002,
    InvalidAddress = 0x8003,
    WriteProtect = 0x8004,
    BadAlignment = 0x8005,
    AccessDenied = 0x8006,
    /// Of a packet: it is not, or no longer, there.
    PacketUnavailable = 0x800c,
    InvalidHeader = 0x800e,
}

/// What is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Command {
    Discovery,
    ReadRegisters(Vec<u32>),
    WriteRegisters(Vec<(u32, u32)>),
    ReadMemory { address: u32, count: u16 },
    WriteMemory { address: u32, bytes: Vec<u8> },
    Resend(Resend),
}

/// Packets that are asked for again: those of `block` from `first` to `last`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Resend {
    pub(super) block: u64,
    pub(super) first: u32,
    pub(super) last: u32,
    pub(super) extended: bool,
}

/// A command with its number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Request {
    pub(super) id: u16,
    pub(super) acknowledge: bool,
    pub(super) command: Command,
}

/// A datagram that is no command, with the acknowledge for it, if it is for this protocol and asks for one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Refused(pub(super) Option<Vec<u8>>);

impl Command {
    /// The code of its acknowledge.
    pub(super) const fn acknowledge_code(&self) -> u16 {
        match self {
            Self::Discovery => 0x03,
            Self::ReadRegisters(_) => 0x81,
            Self::WriteRegisters(_) => 0x83,
            Self::ReadMemory { .. } => 0x85,
            Self::WriteMemory { .. } => 0x87,
            Self::Resend(_) => 0x41,
        }
    }
}

/// Big-endian numbers at `at`; the caller has made sure that they are there.
pub(super) fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_be_bytes([bytes[at], bytes[at + 1]])
}

pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from(u16_at(bytes, at)) << 16 | u32::from(u16_at(bytes, at + 2))
}

pub(super) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) << 32 | u64::from(u32_at(bytes, at + 4))
}

/// An acknowledge.
pub(super) fn acknowledge(status: Status, code: u16, id: u16, bytes: &[u8]) -> Vec<u8> {
    let mut datagram = Vec::with_capacity(8 + bytes.len());
    for word in [status as u16, code, bytes.len() as u16, id] {
        datagram.extend(word.to_be_bytes());
    }
    datagram.extend(bytes);
    datagram
}

/// The command in a datagram.
///
/// # Errors
/// [`Refused`] with what is to be answered.
pub(super) fn parse(datagram: &[u8]) -> Result<Request, Refused> {
    if datagram.len() < 8 || datagram[0] != 0x42 {
        return Err(Refused(None));
    }
    let (flags, code, length, id) = (
        datagram[1],
        u16_at(datagram, 2),
        usize::from(u16_at(datagram, 4)),
        u16_at(datagram, 6),
    );
    // A discovery is always answered, whatever its flags say.
    let acknowledged = flags & 1 != 0 || code == 0x02;
    let refuse = |status| {
        Err(Refused(
            acknowledged.then(|| acknowledge(status, code.wrapping_add(1), id, &[])),
        ))
    };
    let bytes = &datagram[8..];
    if bytes.len() != length || length > MOST_BYTES || id == 0 {
        return refuse(Status::InvalidHeader);
    }
    match command(code, flags, bytes) {
        Ok(command) => Ok(Request {
            id,
            acknowledge: acknowledged,
            command,
        }),
        Err(status) => refuse(status),
    }
}

fn command(code: u16, flags: u8, bytes: &[u8]) -> Result<Command, Status> {
    let whole = |step: usize| !bytes.is_empty() && bytes.len().is_multiple_of(step);
    match code {
        0x02 if bytes.is_empty() => Ok(Command::Discovery),
        0x40 => {
            let extended = flags & 0x10 != 0;
            let expected = if extended { 20 } else { 12 };
            // One stream channel, the first.
            if bytes.len() != expected || u16_at(bytes, 0) != 0 {
                return Err(Status::InvalidParameter);
            }
            let bits = if extended { u32::MAX } else { 0xff_ffff };
            Ok(Command::Resend(Resend {
                block: if extended {
                    u64_at(bytes, 12)
                } else {
                    u64::from(u16_at(bytes, 2))
                },
                first: u32_at(bytes, 4) & bits,
                last: u32_at(bytes, 8) & bits,
                extended,
            }))
        }
        0x80 if whole(4) => Ok(Command::ReadRegisters(
            bytes.chunks_exact(4).map(|at| u32_at(at, 0)).collect(),
        )),
        0x82 if whole(8) => Ok(Command::WriteRegisters(
            bytes
                .chunks_exact(8)
                .map(|pair| (u32_at(pair, 0), u32_at(pair, 4)))
                .collect(),
        )),
        0x84 if bytes.len() == 8 => Ok(Command::ReadMemory {
            address: u32_at(bytes, 0),
            count: u16_at(bytes, 6),
        }),
        0x86 if bytes.len() > 4 => Ok(Command::WriteMemory {
            address: u32_at(bytes, 0),
            bytes: bytes[4..].to_vec(),
        }),
        0x02 | 0x80 | 0x82 | 0x84 | 0x86 => Err(Status::InvalidParameter),
        _ => Err(Status::NotImplemented),
    }
}
