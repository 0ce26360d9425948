//! The USB link: a CDC-ACM serial port.
//!
//! # Design
//! A cable can be pulled and a program can stop reading. What is sent to nobody is dropped, so that the other
//! link is not held up: while the device is not configured, and, once a packet was not fetched for
//! [`PATIENCE`], until the host sends something again. A half-received frame is forgotten whenever the host
//! opens, closes or loses the port.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_executor::Spawner;
use embassy_futures::select::{Either, select};
use embassy_rp::Peri;
use embassy_rp::peripherals::USB;
use embassy_rp::usb::Driver;
use embassy_time::{Duration, with_timeout};
use embassy_usb::class::cdc_acm::{CdcAcmClass, ControlChanged, Receiver, Sender, State};
use embassy_usb::{Builder, Config, UsbDevice};
use rcg_protocol::{Decoder, MAX_FRAME};
use static_cell::StaticCell;

use crate::board::Irqs;
use crate::controller::{cut, next_frame};
use crate::links::{LinkId, woken};

/// Vendor and product for tests of open hardware (pid.codes); a product that is sold needs its own.
const VENDOR_PRODUCT: (u16, u16) = (0x1209, 0x0001);

/// Longest packet of a full-speed bulk endpoint.
const PACKET: usize = 64;

/// How long a packet may wait for the host to fetch it.
const PATIENCE: Duration = Duration::from_millis(300);

/// Bytes at an address at which a packet can be copied word by word.
#[repr(align(4))]
struct Aligned<const N: usize>([u8; N]);

/// Whether somebody reads what is sent.
static LISTENED_TO: AtomicBool = AtomicBool::new(false);

type UsbDriver = Driver<'static, USB>;

/// Starts the tasks of the USB port.
pub(crate) fn spawn(spawner: Spawner, usb: Peri<'static, USB>) {
    static CONFIG: StaticCell<[u8; 256]> = StaticCell::new();
    static BOS: StaticCell<[u8; 64]> = StaticCell::new();
    static CONTROL: StaticCell<[u8; 64]> = StaticCell::new();
    static STATE: StaticCell<State> = StaticCell::new();

    let mut config = Config::new(VENDOR_PRODUCT.0, VENDOR_PRODUCT.1);
    config.manufacturer = Some("RCG");
    config.product = Some("RCG trigger box");
    // The flash's own number can be read through the boot ROM only, which the firmware never calls.
    config.serial_number = Some("1");
    let mut builder = Builder::new(
        Driver::new(usb, Irqs),
        config,
        CONFIG.init([0; 256]),
        BOS.init([0; 64]),
        &mut [],
        CONTROL.init([0; 64]),
    );
    let class = CdcAcmClass::new(&mut builder, STATE.init(State::new()), PACKET as u16);
    let (sender, receiver, control) = class.split_with_control();
    spawner.spawn(usb_device(builder.build()).expect("spawned once"));
    spawner.spawn(usb_in(receiver, control).expect("spawned once"));
    spawner.spawn(usb_out(sender).expect("spawned once"));
}

#[embassy_executor::task]
async fn usb_device(mut device: UsbDevice<'static, UsbDriver>) {
    device.run().await;
}

#[embassy_executor::task]
async fn usb_in(mut receiver: Receiver<'static, UsbDriver>, control: ControlChanged<'static>) {
    let mut decoder = Decoder::new();
    let mut packet = Aligned([0; PACKET]);
    loop {
        receiver.wait_connection().await;
        decoder.reset();
        defmt::info!("USB: connected");
        loop {
            match select(receiver.read_packet(&mut packet.0), control.control_changed()).await {
                Either::First(Ok(count)) => {
                    LISTENED_TO.store(true, Ordering::Relaxed);
                    cut(LinkId::Usb, &mut decoder, &packet.0[..count]);
                }
                Either::First(Err(_)) => break,
                Either::Second(()) => decoder.reset(), // the port was opened or closed
            }
        }
        LISTENED_TO.store(false, Ordering::Relaxed);
        defmt::info!("USB: disconnected");
    }
}

#[embassy_executor::task]
async fn usb_out(mut sender: Sender<'static, UsbDriver>) {
    let mut bytes = Aligned([0; PACKET + MAX_FRAME]);
    let bytes = &mut bytes.0;
    let (mut from, mut to) = (0, 0);
    let mut full = false;
    loop {
        // Frames follow each other without a gap, or most packets would be short.
        while to - from < PACKET {
            bytes.copy_within(from..to, 0);
            (from, to) = (0, to - from);
            let length = next_frame(LinkId::Usb, &mut bytes[to..]);
            if length == 0 {
                break;
            }
            to += length;
        }
        // A transfer that ends with a full packet needs an empty one, or the host waits for more.
        if from == to && !full {
            woken(LinkId::Usb).await;
            continue;
        }
        if !LISTENED_TO.load(Ordering::Relaxed) {
            (from, full) = (to, false);
            continue;
        }
        let packet = &bytes[from..to.min(from + PACKET)];
        from += packet.len();
        full = packet.len() == PACKET;
        let sent = with_timeout(PATIENCE, sender.write_packet(packet)).await;
        if !matches!(sent, Ok(Ok(()))) {
            LISTENED_TO.store(false, Ordering::Relaxed);
            defmt::warn!("USB: nobody reads");
        }
    }
}
