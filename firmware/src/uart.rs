//! The UART.

use embassy_executor::Spawner;
use embassy_rp::pac;
use embassy_rp::uart::{BufferedUart, BufferedUartRx, BufferedUartTx, Config};
use embedded_io_async::{Read, Write};
use rcg_protocol::{Decoder, MAX_FRAME};
use static_cell::StaticCell;

use crate::board::{Irqs, UART_BAUD, UartParts};
use crate::controller::{self, cut};
use crate::links::{LinkId, woken};

/// Bytes that wait to be read: two frames of the longest kind, and the time that they take.
const UART_RX_BYTES: usize = 1024;
/// Bytes that wait to be sent: a millisecond of them, in which the next frame is made.
const UART_TX_BYTES: usize = 128;

/// `RXIFLSEL` of the PL011: interrupt at 16 of 32 bytes (data sheet of the RP2040, UARTIFLS).
const HALF_FULL: u8 = 0b010;

/// GPIO of RX.
const RX_PIN: usize = 1;

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
    // The first interrupt when the FIFO is half full: what is left, 170 µs, outlasts any critical section. As it
    // comes from the HAL it would be 40 µs.
    pac::UART0.uartifls().modify(|w| w.set_rxiflsel(HALF_FULL));
    // A line that nobody drives is at rest.
    pac::PADS_BANK0.gpio(RX_PIN).modify(|w| {
        w.set_pue(true);
        w.set_pde(false);
        w.set_schmitt(true);
    });
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
            Ok(count) => cut(LinkId::Uart, &mut decoder, &bytes[..count]),
            // Bytes are missing now: the frame's CRC will tell, and the host asks again.
            Err(error) => defmt::warn!("UART: {}", error),
        }
    }
}

#[embassy_executor::task]
async fn uart_out(mut tx: BufferedUartTx) {
    let mut frame = [0; MAX_FRAME];
    loop {
        let (length, _) = controller::next_frame(LinkId::Uart, &mut frame);
        if length == 0 {
            woken(LinkId::Uart).await;
        } else if let Err(error) = tx.write_all(&frame[..length]).await {
            defmt::warn!("UART: {}", error);
        }
    }
}
