//! All commands and their options, as the program's own help tells them, and a quick and valid use of each.
//!
//! # Design
//! Tables over all commands are drawn from the help, so that a new option is tested by being there. A new command fails
//! [`every_command_has_a_use`] until it has a line in [`Scene::uses`].

use std::path::{Path, PathBuf};

use crate::command::{quick, run, text};

/// An option that takes a value.
#[derive(Clone, Debug)]
pub(crate) struct Valued {
    /// With its dashes.
    pub(crate) name: String,
}

/// A command without commands below it.
#[derive(Clone, Debug)]
pub(crate) struct Described {
    /// The words that call it.
    pub(crate) words: Vec<String>,
    pub(crate) options: Vec<Valued>,
}

/// All commands.
pub(crate) fn described() -> Vec<Described> {
    let (mut open, mut found) = (vec![Vec::<String>::new()], Vec::new());
    while let Some(words) = open.pop() {
        let mut arguments = words.clone();
        arguments.push("--help".to_owned());
        let outcome = run(&arguments, "");
        let help = outcome.done();
        let below: Vec<&str> = commands(help)
            .filter_map(|line| line.strip_prefix("  ")?.split(' ').next())
            .filter(|name| !name.is_empty() && *name != "help")
            .collect();
        if below.is_empty() {
            let options = help.lines().filter_map(valued).collect();
            found.push(Described {
                words: words.clone(),
                options,
            });
        }
        open.extend(
            below
                .iter()
                .map(|name| [&words[..], &[(*name).to_owned()]].concat()),
        );
    }
    found.sort_by(|a, b| a.words.cmp(&b.words));
    found
}

/// Lines below the headings of commands.
fn commands(help: &str) -> impl Iterator<Item = &str> {
    let mut is_within = false;
    help.lines().filter(move |line| {
        let is_heading = line.starts_with("Commands") && line.ends_with(':');
        is_within = is_heading || is_within && !line.is_empty();
        is_within && !is_heading
    })
}

fn valued(line: &str) -> Option<Valued> {
    let line = line.trim_start();
    let mut words = line.split_whitespace().filter(|_| line.starts_with('-'));
    let name = words.find(|word| word.starts_with("--"))?;
    words.next()?.strip_prefix('<')?;
    Some(Valued {
        name: name.to_owned(),
    })
}

/// A folder with what commands read.
pub(crate) struct Scene {
    folder: tempfile::TempDir,
}

/// A valid use of a command.
#[derive(Clone, Debug)]
pub(crate) struct Use {
    /// Words, arguments and options.
    pub(crate) arguments: Vec<String>,
    pub(crate) stdin: &'static str,
}

/// A moment of `rcg camera bench`.
const TRIAL: &str = "--source synthetic --image-size 8 --seconds 0.05 --frames-per-s 200";

impl Scene {
    /// With two measurements, and one that is only planned.
    pub(crate) fn new() -> Self {
        let scene = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        run(&quick(&scene.path("measured")), "").done();
        let mut repeated = quick(&scene.path("repeated"));
        repeated.extend(["--sample", "lambert"].map(str::to_owned));
        run(&repeated, "").done();
        let plan = [
            "plan",
            "--step",
            "30",
            "--image-size",
            "8",
            "--exposure-ms",
            "4",
            "--out",
        ];
        run(&[&plan[..], &[text(&scene.path("planned"))]].concat(), "").done();
        if cfg!(feature = "collection") {
            for command in ["init", "add"] {
                run(&["collection", command, text(scene.folder())], "").done();
            }
        }
        scene
    }

    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Uses of the command that `words` call, which write into `out`; none of one that takes minutes.
    ///
    /// # Panics
    /// If there is no line for the command.
    pub(crate) fn uses(&self, words: &[String], out: &Path) -> Vec<Use> {
        let place = |name: &str| text(&self.path(name)).to_owned();
        let [measured, planned, repeated, brdf] =
            ["measured", "planned", "repeated", "measured/brdf.zarr"].map(place);
        let file = |name: &str| text(&out.join(name)).to_owned();
        let dir = text(out).to_owned();
        let each = |endings: &[&str], line: &str, stem: &str| -> Vec<String> {
            let files = endings.iter().map(|ending| file(&format!("{stem}.{ending}")));
            files.map(|file| format!("{line} {file}")).collect()
        };
        let tiny = "--step 30 --image-size 8";
        let lines: Vec<String> = match words.join(" ").as_str() {
            "measure" | "plan" => vec![format!("--out {dir} {tiny} --exposure-ms 4")],
            "patterns" => vec![format!("--out {dir} --step 45")],
            "capture" => vec![planned],
            "assemble" => vec![measured],
            "calibrate geometry" => vec![format!("--out {dir} --image-size 64")],
            "calibrate photometry" => vec![format!("--out {dir} --image-size 16")],
            "rig check" | "map" => vec![String::new()],
            "value" | "info" => vec![brdf],
            "evaluate" => vec![format!("{brdf} --reference ward:brass")],
            "fit" => each(
                &["svg", "pdf", "png"],
                "ward:brass --model ward --residuals",
                "fit",
            ),
            "compare" => each(
                &["svg", "pdf", "png", "csv"],
                &format!("ward:brass {brdf} --out"),
                "c",
            ),
            "export" => exports(&brdf, &file),
            "fill" => vec![format!("{brdf} --out {}", file("whole.zarr"))],
            "combine" => vec![format!("{brdf} {repeated} --out {}", file("mean.zarr"))],
            _ if words[0] == "collection" => self.of_collection(&words[1], &dir, &file("c.html")),
            "history" => histories(&[measured, repeated], &file),
            "turn" => vec![format!("{brdf} --azimuth 20 --out {}", file("turned.zarr"))],
            "budget" => vec![format!("{brdf} --region 45,40")],
            "reflectance" => vec![format!("{brdf} --theta 10,40"), "lambert:0.5".to_owned()],
            "render" => each(&["png", "exr"], "lambert --scene torus --size 8 --out", "a"),
            "plot" => each(&["svg", "pdf", "png", "csv"], "lambert --azimuths 8 --out", "a"),
            "report" => vec![format!("{brdf} --out {}", file("a.html"))],
            "live" => vec!["--once --image-size 32 --exposure-ms 0.004".to_owned()],
            "multiplex" => vec!["--step 30 --image-size 8 --order 3".to_owned()],
            "standard" => vec![standard()],
            "completions" => ["bash", "zsh", "fish"].map(str::to_owned).to_vec(),
            "man" => vec![format!("--out {dir}")],
            "truth" => vec![format!("--out {}", file("truth.toml"))],
            _ if words[0] == "controller" => of_trigger_box(&words[1], &["r.csv", "r.jsonl"].map(&file)),
            // Long, and tried elsewhere; cameras and projectors are tried where there is one, by the
            // trials.
            "bench" | "paper" | "study" | "worlds" | "camera list" | "camera info" | "camera grab"
            | "projector list" | "projector info" | "projector show" | "projector upload"
            | "projector test" | "projector video" => vec![],
            "camera bench" => vec![format!("{TRIAL} --to {dir}")],
            other => panic!("`rcg {other}` has no use here: add a quick one"),
        };
        let stdin = match words[0].as_str() {
            "map" => "45 0\n",
            "value" => "45 0 45 180\n",
            _ => "",
        };
        let port: &[&str] = if words[0] == "controller" {
            &["--port", "sim"]
        } else {
            &[]
        };
        lines
            .iter()
            .map(|line| Use {
                arguments: words
                    .iter()
                    .map(String::as_str)
                    .chain(line.split_whitespace())
                    .chain(port.iter().copied())
                    .map(str::to_owned)
                    .collect(),
                stdin,
            })
            .collect()
    }
}

impl Scene {
    /// Words behind an action on a collection, of which the scene is one; none where the program was built without.
    fn of_collection(&self, action: &str, dir: &str, page: &str) -> Vec<String> {
        let scene = text(self.folder());
        let line = match action {
            _ if !cfg!(feature = "collection") => return Vec::new(),
            "init" => dir.to_owned(),
            "add" => format!("{scene} {scene}/measured"),
            "status" => scene.to_owned(),
            "query" => format!("{scene} --where sigma>0"),
            "page" => format!("{scene} --out {page}"),
            other => panic!("`rcg collection {other}` has no use here: add a quick one"),
        };
        vec![line]
    }
}

/// Words behind an action of the trigger box; none where there is nothing to be stopped, and nothing that takes another firmware.
fn of_trigger_box(action: &str, records: &[String]) -> Vec<String> {
    let words = match action {
        "info" | "status" | "abort" | "forget" => "",
        "run" => {
            let lines = records.iter().map(|file| format!("--steps 3 --records {file}"));
            return lines.collect();
        }
        "stop" | "update" => return Vec::new(),
        "bench" => "--count 3",
        "store" => "--steps 3 --start-on-line --repeat 2",
        "pulse" => "proj --width 5us --count 3",
        "hold" => "cam high --for 2ms",
        "probe" => "--for 30ms --every 10ms",
        "selftest" => "--count 2",
        other => panic!("`rcg controller {other}` has no use here: add a quick one"),
    };
    vec![words.to_owned()]
}

/// Uses of `history` on the two measurements.
fn histories([one, other]: &[String; 2], file: &dyn Fn(&str) -> String) -> Vec<String> {
    let charts = ["h.svg", "h.pdf", "h.png"].map(|name| format!("{one} {other} --out {}", file(name)));
    let table = format!("{other} {one} --csv {}", file("h.csv"));
    charts.into_iter().chain([table]).collect()
}

/// Words behind `rcg export`.
fn exports(brdf: &str, file: &dyn Fn(&str) -> String) -> Vec<String> {
    ["bsdf", "npy", "ssdd", "csv", "exr"]
        .map(|to| {
            let small = match to {
                "bsdf" => "--resolution 8 --step 30 --zeros",
                "exr" => "--resolution 8 --slice 45,0",
                _ => "--step 30",
            };
            format!("--to {to} {brdf} {small} --out {}", file(&format!("e.{to}")))
        })
        .to_vec()
}

/// The example of a certificate.
pub(crate) fn standard() -> String {
    concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/standard.toml").to_owned()
}

#[test]
fn every_command_has_a_use() {
    let scene = Scene::new();
    let commands = described();
    assert!(commands.len() > 20, "{commands:?}");
    for command in &commands {
        assert!(
            command.options.iter().any(|found| found.name == "--rig"),
            "{command:?}"
        );
        let out = scene.path("out");
        for used in scene.uses(&command.words, &out) {
            // Files have a folder, directories make theirs.
            let makes = used.arguments.contains(&text(&out).to_owned());
            if !makes {
                std::fs::create_dir_all(&out).unwrap();
            }
            run(&used.arguments, used.stdin).done();
            if out.exists() {
                std::fs::remove_dir_all(&out).unwrap();
            }
        }
    }
}
