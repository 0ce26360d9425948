//! The USB link: a CDC-ACM serial port.
//!
//! # Design
//! A cable can be pulled and a program can stop reading. What is sent to nobody is dropped, so that the other
//! link is not held up: while the device is not configured, and, once a packet was not fetched for
//! [`PATIENCE`], until the host sends something again. Step records in it are counted as lost. A half-received
//! frame is forgotten whenever the host opens, closes or loses the port.
//!
//! Where USB does not get on any more the box resets itself, once no run is under way, and is back as at power-up.

use core::cell::RefCell;
use core::sync::atomic::{AtomicBool, Ordering};

use embassy_executor::Spawner;
use embassy_futures::select::{Either, select};
use embassy_rp::Peri;
use embassy_rp::peripherals::USB;
use embassy_rp::usb::Driver;
use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
use embassy_time::{Duration, with_timeout};
use embassy_usb::class::cdc_acm::{CdcAcmClass, ControlChanged, Receiver, Sender, State};
use embassy_usb::{Builder, Config, UsbDevice};
use rcg_firmware::packets::{PACKET, Packets};
use rcg_firmware::usb_watch::UsbWatch;
use rcg_protocol::Decoder;
use static_cell::StaticCell;

use crate::board::{Clock, Irqs};
use crate::controller::{self, cut};
use crate::links::{LinkId, woken};

/// Vendor and product for tests of open hardware (pid.codes); a product that is sold needs its own.
const VENDOR_PRODUCT: (u16, u16) = (0x1209, 0x0001);

/// How long a packet may wait for the host to fetch it.
const PATIENCE: Duration = Duration::from_millis(300);

/// Bytes at an address at which a packet can be copied word by word.
#[repr(align(4))]
struct Aligned<const N: usize>([u8; N]);

/// How long frames may fail to come: more than any hub takes to recover, and the port is back in less than two seconds.
const FRAMELESS: Duration = Duration::from_millis(500);

/// Whether somebody reads what is sent.
static LISTENED_TO: AtomicBool = AtomicBool::new(false);

/// What a host sets as the port's speed to ask for the boot loader, in baud: a custom that Arduino began, for a box whose
/// firmware speaks another version.
const TOUCH_BAUD: u32 = 1200;

/// Whether somebody asked for the boot loader by the port's speed and closed the port.
static TOUCHED: AtomicBool = AtomicBool::new(false);

/// Whether somebody asked for the boot loader by the port's speed.
pub(crate) fn was_touched() -> bool {
    TOUCHED.load(Ordering::Relaxed)
}

/// Whether a host has configured the port and has not put it to sleep.
static AWAKE: AtomicBool = AtomicBool::new(false);

static WATCH: Mutex<CriticalSectionRawMutex, RefCell<UsbWatch>> = Mutex::new(RefCell::new(UsbWatch::new()));

/// Whether USB does not get on any more; to be asked every millisecond.
pub(crate) fn is_stuck(clock: Clock) -> bool {
    let frame = embassy_rp::pac::USB.sof_rd().read().count();
    let limit = clock.micros(FRAMELESS.as_micros() as u32);
    let awake = AWAKE.load(Ordering::Relaxed);
    WATCH.lock(|watch| watch.borrow_mut().is_stuck(clock.now(), awake, frame, limit))
}

/// What becomes of the bus.
struct Bus {
    configured: bool,
}

impl embassy_usb::Handler for Bus {
    fn reset(&mut self) {
        self.configured = false;
        AWAKE.store(false, Ordering::Relaxed);
    }

    fn configured(&mut self, configured: bool) {
        self.configured = configured;
        AWAKE.store(configured, Ordering::Relaxed);
    }

    fn suspended(&mut self, suspended: bool) {
        AWAKE.store(self.configured && !suspended, Ordering::Relaxed);
    }
}

type UsbDriver = Driver<'static, USB>;

/// Starts the tasks of the USB port.
#[unsafe(link_section = ".boot_text")]
#[inline(never)]
pub(crate) fn spawn(spawner: Spawner, usb: Peri<'static, USB>, serial: u64) {
    static CONFIG: StaticCell<[u8; 256]> = StaticCell::new();
    static BOS: StaticCell<[u8; 64]> = StaticCell::new();
    static CONTROL: StaticCell<[u8; 64]> = StaticCell::new();
    static STATE: StaticCell<State> = StaticCell::new();
    static BUS: StaticCell<Bus> = StaticCell::new();
    static SERIAL: StaticCell<[u8; 16]> = StaticCell::new();

    let mut config = Config::new(VENDOR_PRODUCT.0, VENDOR_PRODUCT.1);
    config.manufacturer = Some("RCG");
    config.product = Some("RCG trigger box");
    // Without a number of its own it has none: two boxes of one number would be taken for one by their host.
    let serial = SERIAL.init(hexadecimal(serial));
    config.serial_number = core::str::from_utf8(serial)
        .ok()
        .filter(|digits| digits.contains(|c| c != '0'));
    let mut builder = Builder::new(
        Driver::new(usb, Irqs),
        config,
        CONFIG.init([0; 256]),
        BOS.init([0; 64]),
        &mut [],
        CONTROL.init([0; 64]),
    );
    builder.handler(BUS.init(Bus { configured: false }));
    let class = CdcAcmClass::new(&mut builder, STATE.init(State::new()), PACKET as u16);
    let (sender, receiver, control) = class.split_with_control();
    spawner.spawn(usb_device(builder.build()).expect("spawned once"));
    spawner.spawn(usb_in(receiver, control).expect("spawned once"));
    spawner.spawn(usb_out(sender).expect("spawned once"));
}

/// `number` in hexadecimal digits.
fn hexadecimal(number: u64) -> [u8; 16] {
    core::array::from_fn(|digit| {
        let digit = (number >> (60 - 4 * digit)) as u8 & 15;
        if digit < 10 {
            b'0' + digit
        } else {
            b'a' + digit - 10
        }
    })
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
                Either::Second(()) => {
                    decoder.reset(); // the port was opened or closed
                    let touched = receiver.line_coding().data_rate() == TOUCH_BAUD && !control.dtr();
                    TOUCHED.store(touched, Ordering::Relaxed);
                }
            }
        }
        LISTENED_TO.store(false, Ordering::Relaxed);
        defmt::info!("USB: disconnected");
    }
}

#[embassy_executor::task]
async fn usb_out(mut sender: Sender<'static, UsbDriver>) {
    let mut packets = Packets::new();
    loop {
        packets.fill(|room| controller::next_frame(LinkId::Usb, room));
        let Some(packet) = packets.packet() else {
            woken(LinkId::Usb).await;
            continue;
        };
        if !LISTENED_TO.load(Ordering::Relaxed) {
            controller::records_lost(packets.lost());
            continue;
        }
        match with_timeout(PATIENCE, sender.write_packet(packet)).await {
            Ok(Ok(())) => {
                packets.sent();
                WATCH.lock(|watch| watch.borrow_mut().packet(true));
            }
            failed => {
                if failed.is_err() {
                    WATCH.lock(|watch| watch.borrow_mut().packet(false));
                }
                LISTENED_TO.store(false, Ordering::Relaxed);
                defmt::warn!("USB: nobody reads");
                controller::records_lost(packets.lost());
            }
        }
    }
}
