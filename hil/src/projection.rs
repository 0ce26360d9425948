//! What shows the patterns of a [table](crate::table).

use std::path::Path;
use std::sync::{Arc, Mutex};

use rcg::instrument::drivers::{self, Files, ProjectorDriver, Window};
use rcg::instrument::rig::Rig;
use rcg::virtual_rig::VirtualProjector;

use crate::bridge::Photodiode;
use crate::dlpc900::{Dlpc900, Served};

/// A screen that a window fills, in place of the folder.
pub struct Screen {
    /// What the rig file says of it.
    pub window: Window,
    /// What looks at it.
    pub photodiode: Box<dyn Photodiode>,
    /// Where what looks at it finds the virtual projector once there is one.
    pub projector: Arc<Mutex<Option<VirtualProjector>>>,
}

/// What shows the patterns.
pub enum Projection<'a> {
    /// A folder that takes them.
    Folder(&'a Path),
    /// Micromirrors; beside the path is the file that says what stands in the holder.
    Mirrors(&'a Dlpc900, &'a Path),
    /// A screen.
    Screen(Screen),
}

impl Projection<'_> {
    /// Gives `rig` this projector, the port of which is `served` where it has one.
    pub(crate) fn equip(&self, rig: &mut Rig, served: Option<&Served>) {
        let projector = &mut rig.projector;
        match self {
            Projection::Folder(folder) => {
                projector.driver = ProjectorDriver::Files;
                projector.files = Some(Files {
                    folder: folder.to_path_buf(),
                    // A busy machine looks at what stands in the holder for as long as it takes.
                    patience_s: 600.0,
                });
            }
            Projection::Mirrors(..) => {
                projector.driver = ProjectorDriver::Dlpc900;
                projector.dlpc900 = Some(drivers::Dlpc900 {
                    device: served.map(Served::device),
                    ..drivers::Dlpc900::default()
                });
            }
            Projection::Screen(screen) => {
                projector.driver = ProjectorDriver::Window;
                projector.window = Some(screen.window.clone());
            }
        }
    }
}
