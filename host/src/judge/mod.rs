//! Judgement of a result: errors and reciprocity, fits, pictures, charts and scans.

pub mod chart;
pub mod evaluate;
pub mod fit;
pub mod render;
pub mod scan;
