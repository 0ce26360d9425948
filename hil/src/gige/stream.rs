//! The stream channel: frames get their ids, go out, and are kept for when packets of them are asked for again.

use std::collections::VecDeque;
use std::net::{SocketAddrV4, UdpSocket};
use std::sync::Arc;

use super::faults::Faults;
use super::gvcp::{Resend, Status};
use super::gvsp::{self, Frame, Shot};
use super::settings::Settings;

/// Frames that are kept at most …
const MOST_FRAMES: usize = 4096;
/// … and their bytes, beyond the last frame.
const MOST_BYTES: usize = 256 << 20;
/// Packets that one request is answered with.
const MOST_RESENT: u32 = 65_536;

/// What has happened since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames that were given ids.
    pub frames: u64,
    /// Packets that were sent, those that were sent again included.
    pub packets: u64,
    /// Packets that were lost on purpose, those of starved frames not included.
    pub dropped: u64,
    /// Frames that were withheld on purpose.
    pub starved: u64,
    /// Triggers that were swallowed.
    pub swallowed: u64,
    /// Requests to send packets again.
    pub resend_requests: u64,
    /// Packets that were sent again.
    pub resent: u64,
    /// Packets that were asked for and are not there.
    pub unavailable: u64,
    /// Packets that the system did not take.
    pub send_errors: u64,
    /// How often a client lost control because it was not heard for too long.
    pub control_lost: u64,
    /// Commands that were refused.
    pub refused: u64,
}

/// The stream channel.
pub(super) struct Stream {
    socket: Arc<UdpSocket>,
    resends: bool,
    first_id: u64,
    next_id: u64,
    kept: VecDeque<Frame>,
    kept_bytes: usize,
    packet: Vec<u8>,
    pub(super) faults: Faults,
    pub(super) counts: Counts,
}

impl Stream {
    pub(super) fn new(socket: Arc<UdpSocket>, settings: &Settings) -> Self {
        Self {
            socket,
            resends: settings.resend,
            first_id: settings.first_id,
            next_id: settings.first_id,
            kept: VecDeque::new(),
            kept_bytes: 0,
            packet: Vec::new(),
            faults: Faults::default(),
            counts: Counts::default(),
        }
    }

    /// Ids begin again, and what was is forgotten.
    pub(super) fn begin(&mut self) {
        self.next_id = self.first_id;
        self.kept.clear();
        self.kept_bytes = 0;
    }

    fn take_id(&mut self, extended: bool) -> u64 {
        // There is no block 0, and of 16-bit ids none above 65,535.
        let most = if extended { u64::MAX } else { 65_535 };
        let advanced = |id: u64, by: u64| {
            let zero_based = u128::from(id - 1) + u128::from(by);
            (zero_based % u128::from(most)) as u64 + 1
        };
        let id = advanced(self.next_id, self.faults.jump(self.next_id));
        self.next_id = advanced(id, 1);
        id
    }

    /// Sends a frame. Returns its id, and whether it was sent.
    pub(super) fn send(&mut self, shot: Shot<'_>) -> (u64, bool) {
        let id = self.take_id(shot.config.extended_ids);
        self.counts.frames += 1;
        if self.faults.starved.contains(&id) {
            self.counts.starved += 1;
            return (id, false);
        }
        let strange = self.strange(id, &shot);
        let frame = match &strange {
            Some((config, image)) => Frame::new(
                id,
                Shot {
                    config,
                    image: Arc::clone(image),
                    ..shot
                },
            ),
            None => Frame::new(id, shot),
        };
        let times = 1 + u32::from(self.faults.duplicated.contains(&id));
        for _ in 0..times {
            for packet in 0..frame.packets() {
                self.send_packet(&frame, packet, None);
            }
        }
        if self.resends {
            self.keep(frame);
        }
        (id, true)
    }

    /// A frame in another format or size than is set: its configuration and image, cut or filled up with zeros.
    fn strange(&self, id: u64, shot: &Shot<'_>) -> Option<(super::Config, Arc<[u8]>)> {
        let format = self.faults.formats.iter().find(|(at, _)| *at == id);
        let size = self.faults.sizes.iter().find(|(at, _)| *at == id);
        if format.is_none() && size.is_none() {
            return None;
        }
        let mut config = shot.config.clone();
        if let Some((_, format)) = format {
            config.format = *format;
        }
        if let Some((_, (width, height))) = size {
            config.region.width = *width;
            config.region.height = *height;
        }
        let mut image = shot.image.to_vec();
        image.resize(config.image_bytes(), 0);
        Some((config, image.into()))
    }

    fn keep(&mut self, frame: Frame) {
        self.kept_bytes += frame.bytes();
        self.kept.push_back(frame);
        while self.kept.len() > MOST_FRAMES || (self.kept_bytes > MOST_BYTES && self.kept.len() > 1) {
            if let Some(oldest) = self.kept.pop_front() {
                self.kept_bytes -= oldest.bytes();
            }
        }
    }

    fn send_packet(&mut self, frame: &Frame, packet: u32, again: Option<Status>) {
        if self.faults.loses(frame.id, packet, again.is_some()) {
            self.counts.dropped += 1;
            return;
        }
        frame.packet(
            packet,
            again.filter(|&status| status != Status::Success),
            &mut self.packet,
        );
        self.send_bytes(frame.destination);
    }

    fn send_bytes(&mut self, destination: SocketAddrV4) -> bool {
        let sent = self.socket.send_to(&self.packet, destination).is_ok();
        if sent {
            self.counts.packets += 1;
        } else {
            self.counts.send_errors += 1;
        }
        sent
    }

    /// Sends packets again, `status` is what they are marked with; where they are gone says so to `destination`.
    pub(super) fn resend(&mut self, wanted: Resend, status: Status, destination: Option<SocketAddrV4>) {
        self.counts.resend_requests += 1;
        let named = |frame: &Frame| frame.id == wanted.block && frame.extended == wanted.extended;
        // The newest is nearest to what is asked for, and of ids that came round again the right one.
        let place = self.kept.iter().rposition(named);
        let Some(frame) = place.and_then(|place| self.kept.remove(place)) else {
            self.counts.unavailable += 1;
            if let Some(destination) = destination {
                self.packet.clear();
                let gone = Some(Status::PacketUnavailable);
                gvsp::head(
                    wanted.extended,
                    wanted.block,
                    3,
                    wanted.first,
                    gone,
                    &mut self.packet,
                );
                self.send_bytes(destination);
            }
            return;
        };
        let last = wanted
            .last
            .min(frame.packets() - 1)
            .min(wanted.first.saturating_add(MOST_RESENT - 1));
        for packet in wanted.first..=last {
            self.send_packet(&frame, packet, Some(status));
            self.counts.resent += 1;
        }
        if let Some(place) = place {
            self.kept.insert(place, frame);
        }
    }

    /// Fires a test packet of `packet_bytes`, which no loss touches.
    pub(super) fn test_packet(&mut self, packet_bytes: u32, destination: SocketAddrV4) {
        self.packet.clear();
        self.packet
            .resize((packet_bytes - gvsp::IP_AND_UDP_BYTES) as usize, 0);
        self.send_bytes(destination);
    }
}
