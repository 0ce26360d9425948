//! Judgement of a result: errors and reciprocity, fits, pictures, charts, scans, repeats and their history, and whole worlds drawn by chance.

pub mod chart;
pub mod compare;
pub mod differences;
pub mod evaluate;
pub mod fit;
pub mod history;
pub mod outgoing_map;
pub mod quantity;
pub mod reflectance;
pub mod region;
pub mod render;
pub mod repeats;
pub mod scan;
pub mod worlds;
