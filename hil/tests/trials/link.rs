//! TODO
crate::trials!("link": );
