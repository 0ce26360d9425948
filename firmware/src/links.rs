//! The links to the host: what they have in common, and the UART.
//!
//! # Design
//! Each link has two tasks. The one that reads cuts frames out of the bytes and passes what they hold on; the
//! one that writes asks for the next frame when the one before it is on its way, so that an answer waits behind a
//! frame or two and not behind all that was said before. Neither knows what frames mean.

use embassy_executor::Spawner;
use embassy_rp::uart::{BufferedUart, BufferedUartRx, BufferedUartTx, Config};
use embassy_sync::{blocking_mutex::raw::CriticalSectionRawMutex, signal::Signal};
use embedded_io_async::{Read, Write};
use rcg_protocol::{Decoder, MAX_FRAME, decode};
use static_cell::StaticCell;

use crate::board::{Irqs, UART_BAUD, UartParts};
use crate::controller;

/// Bytes that wait to be read: two frames of the longest kind, and the time that they take.
const UART_RX_BYTES: usize = 1024;
/// Bytes that wait to be sent: a millisecond of them, in which the next frame is made.
const UART_TX_BYTES: usize = 128;

/// A link to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub(crate) enum LinkId {
    /// UART0.
    Uart,
    /// USB CDC-ACM.
    Usb,
}

type Wake = Signal<CriticalSectionRawMutex, ()>;

static WAKE_UART: Wake = Signal::new();
static WAKE_USB: Wake = Signal::new();

/// What the task waits for that writes to `link`, when it has nothing to write.
const fn wake_of(link: LinkId) -> &'static Wake {
    match link {
        LinkId::Uart => &WAKE_UART,
        LinkId::Usb => &WAKE_USB,
    }
}

/// There is a message for `link`.
pub(crate) fn wake(link: LinkId) {
    wake_of(link).signal(());
}

/// Waits until there may be a message for `link`.
pub(crate) async fn woken(link: LinkId) {
    wake_of(link).wait().await;
}

/// Cuts frames out of `bytes` and passes them on.
pub(crate) fn receive(link: LinkId, decoder: &mut Decoder, mut bytes: &[u8]) {
    while let Some(frame) = decoder.frame(&mut bytes) {
        match frame {
            Ok(frame) => match decode(frame) {
                Ok(message) => controller::receive(link, &message),
                Err(error) => controller::receive_corrupt(link, error),
            },
            Err(error) => controller::receive_corrupt(link, error),
        }
    }
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
            Ok(count) => receive(LinkId::Uart, &mut decoder, &bytes[..count]),
            // Bytes are missing now: the frame's CRC will tell, and the host asks again.
            Err(error) => defmt::warn!("UART: {}", error),
        }
    }
}

#[embassy_executor::task]
async fn uart_out(mut tx: BufferedUartTx) {
    let mut frame = [0; MAX_FRAME];
    loop {
        let length = controller::next_frame(LinkId::Uart, &mut frame);
        if length == 0 {
            woken(LinkId::Uart).await;
        } else if let Err(error) = tx.write_all(&frame[..length]).await {
            defmt::warn!("UART: {}", error);
        }
    }
}
