//! A client of GigE Vision cameras: commands, and blocks put together from packets.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// A loopback address that no other test has, not even one of another process.
pub(crate) fn address() -> Ipv4Addr {
    static NEXT: AtomicU32 = AtomicU32::new(1);
    let next = NEXT.fetch_add(1, Ordering::Relaxed);
    assert!(next < 250, "no more addresses");
    let process = std::process::id();
    Ipv4Addr::from(0x7f40_0000 | (process & 0x3fff) << 8 | next)
}

/// SplitMix64 (Steele, Lea & Flood 2014).
pub(crate) struct Chance(pub u64);

impl Chance {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }
}

/// So many digital numbers.
pub(crate) fn dn(chance: &mut Chance, count: u32) -> Vec<u16> {
    (0..count).map(|_| chance.next() as u16).collect()
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_be_bytes(bytes[at..at + 2].try_into().unwrap())
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_be_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// A packet of the stream.
pub(crate) struct Packet {
    pub(crate) status: u16,
    pub(crate) id: u64,
    pub(crate) kind: u8,
    pub(crate) number: u32,
    pub(crate) resent: bool,
    pub(crate) bytes: Vec<u8>,
}

/// A frame, put together.
pub(crate) struct Block {
    pub(crate) id: u64,
    pub(crate) ticks: u64,
    pub(crate) format: u32,
    pub(crate) region: [u32; 4],
    pub(crate) payload: Vec<u8>,
    /// Bytes of its largest datagram.
    pub(crate) largest: usize,
    chunked: bool,
}

impl Block {
    /// Chunks from the end of the payload: id, value; the image, which is the last, aside.
    pub(crate) fn chunks(&self) -> Vec<(u32, u64)> {
        self.walk().0
    }

    /// The image, without what fills it up.
    pub(crate) fn image(&self) -> &[u8] {
        let bits =
            u64::from(self.region[0]) * u64::from(self.region[1]) * u64::from(self.format >> 16 & 0xff);
        let whole = self.walk().1;
        let image = bits.div_ceil(8) as usize;
        assert!(whole.len() == image || (self.chunked && whole.len() == image.next_multiple_of(4)));
        &whole[..image]
    }

    fn walk(&self) -> (Vec<(u32, u64)>, &[u8]) {
        let mut rest = &self.payload[..];
        let mut chunks = Vec::new();
        if !self.chunked {
            return (chunks, rest);
        }
        loop {
            let (data, end) = rest.split_at(rest.len() - 8);
            let (id, length) = (u32_at(end, 0), u32_at(end, 4) as usize);
            let (before, value) = data.split_at(data.len() - length);
            if id == 0xa0 {
                assert!(before.is_empty());
                return (chunks, value);
            }
            chunks.push((id, u64_at(value, 0)));
            rest = before;
        }
    }
}

/// A client with its control and its stream channel.
pub(crate) struct Client {
    control: UdpSocket,
    stream: UdpSocket,
    id: u16,
}

impl Client {
    pub(crate) fn new(camera: SocketAddrV4) -> Self {
        let bound = || UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let (control, stream) = (bound(), bound());
        control.connect(camera).unwrap();
        control
            .set_read_timeout(Some(Duration::from_millis(300)))
            .unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        Self {
            control,
            stream,
            id: 0,
        }
    }

    pub(crate) fn address(&self) -> SocketAddrV4 {
        match self.control.local_addr().unwrap() {
            SocketAddr::V4(address) => address,
            SocketAddr::V6(_) => unreachable!("it is bound to an IPv4 address"),
        }
    }

    pub(crate) fn port(&self) -> u16 {
        self.address().port()
    }

    fn tell(&mut self, flags: u8, code: u16, bytes: &[u8]) {
        self.id = self.id % 65_535 + 1;
        let mut datagram = vec![0x42, flags];
        for word in [code, bytes.len() as u16, self.id] {
            datagram.extend(word.to_be_bytes());
        }
        datagram.extend(bytes);
        self.control.send(&datagram).unwrap();
    }

    /// Status, code and bytes of the acknowledge to a command; `None` if there is none, however often it is asked.
    pub(crate) fn ask(&mut self, code: u16, bytes: &[u8]) -> Option<(u16, u16, Vec<u8>)> {
        for _ in 0..3 {
            self.tell(1, code, bytes);
            let mut answer = [0; 1024];
            while let Ok(length) = self.control.recv(&mut answer) {
                // One that was given up before may still come.
                if u16_at(&answer, 6) != self.id {
                    continue;
                }
                assert_eq!(usize::from(u16_at(&answer, 4)), length - 8);
                return Some((u16_at(&answer, 0), u16_at(&answer, 2), answer[8..length].to_vec()));
            }
        }
        None
    }

    fn answered(&mut self, code: u16, bytes: &[u8]) -> Result<Vec<u8>, u16> {
        let (status, acknowledge, bytes) = self.ask(code, bytes).expect("the camera answers");
        assert_eq!(acknowledge, code + 1);
        if status == 0 { Ok(bytes) } else { Err(status) }
    }

    pub(crate) fn read(&mut self, at: u32) -> Result<u32, u16> {
        self.answered(0x80, &at.to_be_bytes())
            .map(|bytes| u32_at(&bytes, 0))
    }

    pub(crate) fn memory(&mut self, at: u32, count: u16) -> Result<Vec<u8>, u16> {
        let mut bytes = at.to_be_bytes().to_vec();
        bytes.extend(u32::from(count).to_be_bytes());
        let answer = self.answered(0x84, &bytes)?;
        assert_eq!(u32_at(&answer, 0), at);
        Ok(answer[4..].to_vec())
    }

    pub(crate) fn write(&mut self, at: u32, value: u32) -> Result<(), u16> {
        let bytes = (u64::from(at) << 32 | u64::from(value)).to_be_bytes();
        self.answered(0x82, &bytes).map(|_| ())
    }

    pub(crate) fn write_memory(&mut self, at: u32, value: &[u8]) -> Result<(), u16> {
        let bytes = [&at.to_be_bytes(), value].concat();
        self.answered(0x86, &bytes).map(|_| ())
    }

    /// Writes registers that are there to be written.
    pub(crate) fn set(&mut self, registers: &[(u32, u32)]) {
        for &(at, value) in registers {
            assert_eq!(self.write(at, value), Ok(()), "{at:x} = {value:x}");
        }
    }

    pub(crate) fn control(&mut self) {
        self.set(&[(0xa00, 2)]);
    }

    pub(crate) fn open_stream(&mut self) {
        let port = self.stream.local_addr().unwrap().port();
        self.set(&[(0xd18, Ipv4Addr::LOCALHOST.to_bits()), (0xd00, port.into())]);
    }

    pub(crate) fn resend(&mut self, extended: bool, block: u64, first: u32, last: u32) {
        let mut bytes = vec![0, 0];
        bytes.extend(if extended { 0 } else { block as u16 }.to_be_bytes());
        bytes.extend(first.to_be_bytes());
        bytes.extend(last.to_be_bytes());
        if extended {
            bytes.extend(block.to_be_bytes());
        }
        self.tell(if extended { 0x10 } else { 0 }, 0x40, &bytes);
    }

    /// The next datagram of the stream.
    pub(crate) fn datagram(&self) -> Vec<u8> {
        let mut bytes = vec![0; 65_536];
        let length = self.stream.recv(&mut bytes).expect("a packet comes");
        bytes.truncate(length);
        bytes
    }

    fn packet(&self, extended: bool) -> (Packet, usize) {
        let bytes = self.datagram();
        assert_eq!(bytes[4] & 0x80 != 0, extended);
        let (id, number, head) = if extended {
            (u64_at(&bytes, 8), u32_at(&bytes, 16), 20)
        } else {
            (u16_at(&bytes, 2).into(), u32_at(&bytes, 4) & 0xff_ffff, 8)
        };
        let packet = Packet {
            status: u16_at(&bytes, 0),
            id,
            kind: bytes[4] & 0x7f,
            number,
            resent: extended && bytes[3] & 1 == 1,
            bytes: bytes[head..].to_vec(),
        };
        (packet, bytes.len())
    }

    /// The next packets.
    pub(crate) fn packets(&self, extended: bool, count: usize) -> Vec<Packet> {
        (0..count).map(|_| self.packet(extended).0).collect()
    }

    /// The next frame, which must come whole and in order.
    pub(crate) fn block(&self, extended: bool) -> Block {
        let (leader, mut largest) = self.packet(extended);
        assert_eq!((leader.status, leader.kind, leader.number), (0, 1, 0));
        let bytes = &leader.bytes;
        assert_eq!(bytes.len(), 36);
        let kind = u32_at(bytes, 0);
        let mut payload = Vec::new();
        for number in 1.. {
            let (packet, length) = self.packet(extended);
            assert_eq!((packet.status, packet.id, packet.number), (0, leader.id, number));
            largest = largest.max(length);
            if packet.kind == 2 {
                assert_eq!(
                    (u32_at(&packet.bytes, 0), u32_at(&packet.bytes, 4)),
                    (kind, u32_at(bytes, 20))
                );
                assert_eq!(packet.bytes.len(), if kind == 1 { 8 } else { 16 });
                break;
            }
            assert_eq!(packet.kind, 3);
            payload.extend(packet.bytes);
        }
        Block {
            id: leader.id,
            ticks: u64_at(bytes, 4),
            format: u32_at(bytes, 12),
            region: [16, 20, 24, 28].map(|at| u32_at(bytes, at)),
            payload,
            largest,
            chunked: kind == 0x4001,
        }
    }
}
