//! TODO
crate::trials!("safety": );
