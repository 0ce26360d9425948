//! The links to the host by name, and how one is told that there is something to send.
//!
//! # Design
//! Each link has two tasks. The one that reads hands its bytes to the controller, which cuts frames out of them; the one that
//! writes asks for the next frame when the one before it is on its way, so that an answer waits behind a frame or two and not
//! behind all that was said before. Neither knows what frames mean.

use embassy_sync::{blocking_mutex::raw::CriticalSectionRawMutex, signal::Signal};

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
