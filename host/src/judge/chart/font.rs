//! The font that is built in, so that no installed one is needed.

use std::sync::Once;

use plotters::style::{FontStyle, register_font};

/// Makes the font known to the drawing library as `sans-serif`.
pub(super) fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let known = register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular());
        assert!(known.is_ok(), "invariant: the font that is built in can be read");
    });
}
