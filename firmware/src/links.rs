//! The links to the host: what they have in common, and the UART.
//!
//! # Design
//! Each link has two tasks. The one that reads cuts frames out of the bytes and passes them to the main loop;
//! the one that writes takes messages from the link's outbox and encodes them. Neither knows what they mean.
//! A reader waits when the main loop is busy, and then the link's own buffer fills.

use embassy_executor::Spawner;
use embassy_rp::uart::{BufferedUart, BufferedUartRx, BufferedUartTx, Config};
use embassy_sync::{blocking_mutex::raw::CriticalSectionRawMutex, channel::Channel};
use embedded_io_async::{Read, Write};
use rcg_protocol::{Decoder, FrameError, MAX_FRAME, ToDevice, ToHost, encode};
use static_cell::StaticCell;

use crate::board::{Irqs, UART_BAUD, UartParts};

/// Bytes that wait to be read: two frames of the longest kind, and the time that they take.
const UART_RX_BYTES: usize = 1024;
/// Bytes that wait to be sent: one frame.
const UART_TX_BYTES: usize = 512;

/// Messages that wait for a link; those that wait for these wait in the session.
const OUTBOX: usize = 4;
/// Frames that wait for the main loop.
const INBOX: usize = 4;

/// A link to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub(crate) enum LinkId {
    /// UART0.
    Uart,
    /// USB CDC-ACM.
    Usb,
}

/// What a link received.
#[allow(clippy::large_enum_variant)] // it is moved once, into the main loop
pub(crate) enum Incoming {
    /// A request.
    Message(ToDevice),
    /// A frame that is none.
    Corrupt(FrameError),
}

pub(crate) type Outbox = Channel<CriticalSectionRawMutex, ToHost, OUTBOX>;

/// What came in, for the main loop.
pub(crate) static REQUESTS: Channel<CriticalSectionRawMutex, (LinkId, Incoming), INBOX> = Channel::new();

static UART_OUTBOX: Outbox = Channel::new();
static USB_OUTBOX: Outbox = Channel::new();

/// Messages that wait to be sent over `link`.
pub(crate) fn outbox(link: LinkId) -> &'static Outbox {
    match link {
        LinkId::Uart => &UART_OUTBOX,
        LinkId::Usb => &USB_OUTBOX,
    }
}

/// Cuts frames out of `bytes` and passes them on.
pub(crate) async fn receive(link: LinkId, decoder: &mut Decoder, bytes: &[u8]) {
    for &byte in bytes {
        match decoder.push(byte) {
            None => {}
            Some(Ok(message)) => REQUESTS.send((link, Incoming::Message(message))).await,
            Some(Err(error)) => REQUESTS.send((link, Incoming::Corrupt(error))).await,
        }
    }
}

/// A frame of `message` in `buffer`.
pub(crate) fn frame<'a>(message: &ToHost, buffer: &'a mut [u8; MAX_FRAME]) -> &'a [u8] {
    encode(message, buffer).expect("MAX_FRAME holds every message")
}

/// Starts the tasks of UART0.
pub(crate) fn spawn(spawner: Spawner, parts: UartParts) {
    static RX: StaticCell<[u8; UART_RX_BYTES]> = StaticCell::new();
    static TX: StaticCell<[u8; UART_TX_BYTES]> = StaticCell::new();
    let mut config = Config::default();
    config.baudrate = UART_BAUD;
    let uart = BufferedUart::new(
        parts.uart,
        parts.tx,
        parts.rx,
        Irqs,
        TX.init([0; UART_TX_BYTES]),
        RX.init([0; UART_RX_BYTES]),
        config,
    );
    let (tx, rx) = uart.split();
    spawner.spawn(uart_in(rx).expect("spawned once"));
    spawner.spawn(uart_out(tx).expect("spawned once"));
}

#[embassy_executor::task]
async fn uart_in(mut rx: BufferedUartRx) {
    let mut decoder = Decoder::new();
    let mut bytes = [0; 64];
    loop {
        match rx.read(&mut bytes).await {
            Ok(count) => receive(LinkId::Uart, &mut decoder, &bytes[..count]).await,
            // Bytes are missing now: the frame's CRC will tell, and the host asks again.
            Err(error) => defmt::warn!("UART: {}", error),
        }
    }
}

#[embassy_executor::task]
async fn uart_out(mut tx: BufferedUartTx) {
    let mut buffer = [0; MAX_FRAME];
    loop {
        let message = UART_OUTBOX.receive().await;
        if let Err(error) = tx.write_all(frame(&message, &mut buffer)).await {
            defmt::warn!("UART: {}", error);
        }
    }
}
