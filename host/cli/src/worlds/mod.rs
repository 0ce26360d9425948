//! `rcg worlds`

mod chain;
mod text;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::anyhow;
use clap::builder::PossibleValuesParser;
use rcg::base::progress::Progress as _;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::PRESETS;
use rcg::judge::worlds::{DrawnRequest, DrawnRig, File, Kind, Outcome, Sizes, Summary, World, build_of};
use rcg::plan::PlanError;
use rcg::store::Lock;
use rcg::store::whole_file::write_whole;
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;
use crate::request::image_size;
use chain::{Chain, Stop};

/// The file that holds how a world ended.
const WORLD: &str = "world.json";

/// Draw whole worlds of the virtual rig, run all stages in each, and judge every result: is any silently wrong?
///
/// Each rig strays from its preset by chance and is calibrated by `truth`, `calibrate geometry` and `calibrate photometry`; on
/// each, samples are measured by `measure` and `fill`, as a user would. A world is right, refused in one sentence, silent
/// (wrong, and nothing says so) or broken (no answer and no sentence). Exit code 1 if any is silent or broken.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Rigs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    count: u64,
    /// Seed of the draw: rig I of a seed is the same however many are drawn
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Number of the first rig
    #[arg(long, value_name = "I", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=1_000_000))]
    first: u64,
    /// Measurements on each rig, each one world
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    requests: u64,
    /// Presets of which the rigs are [default: all]
    #[arg(long, value_name = "PRESET,...", value_delimiter = ',', value_parser = PossibleValuesParser::new(PRESETS))]
    rigs: Vec<String>,
    /// Rigs from good to bad (any), as a careful laboratory has them (1 mm, 0.5°, 1000 : 1 or better), or at the worst (bad)
    #[arg(long, value_name = "any|careful|bad", default_value_t = Kind::Any)]
    kind: Kind,
    /// Degrees between rings of incident directions; must divide 90
    #[arg(long, value_name = "DEG", default_value_t = 15.0)]
    step: f64,
    /// Pixels a side of the image of a measurement
    #[arg(long, value_name = "N", default_value_t = 48, value_parser = image_size)]
    image_size: u32,
    /// Pixels a side of the image of the geometric calibration
    #[arg(long, value_name = "N", default_value_t = 96, value_parser = image_size)]
    geometry_image_size: u32,
    /// Pixels a side of the image of the photometric calibration
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = image_size)]
    photometry_image_size: u32,
    /// Rigs at a time; each stage computes on its share of the cores
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=256))]
    jobs: u64,
    /// Directory that keeps everything; worlds that ended in it are not run again [default: nothing is kept]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// What all worlds are run with.
struct Run<'a> {
    args: &'a Args,
    output: &'a Output,
    presets: Vec<&'a str>,
    sizes: Sizes,
    program: PathBuf,
    version: String,
    threads: Option<usize>,
    ended: AtomicUsize,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let grid = Grid::ThetaPhi { step_deg: args.step };
    grid.build().map_err(PlanError::from)?;
    let _lock = args.out.as_deref().map(Lock::folder).transpose()?;
    let program = std::env::current_exe()?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let run = Run {
        args,
        output,
        presets: if args.rigs.is_empty() {
            PRESETS.to_vec()
        } else {
            args.rigs.iter().map(String::as_str).collect()
        },
        sizes: Sizes {
            image_px: args.image_size,
            geometry_px: args.geometry_image_size,
            photometry_px: args.photometry_image_size,
            step_deg: args.step,
        },
        version: build_of(&program)?,
        program,
        threads: (args.jobs > 1).then(|| (cores / args.jobs as usize).max(1)),
        ended: AtomicUsize::new(0),
    };
    let worlds = run.all()?;
    let summary = Summary::of(&worlds);
    let answer = json!({ "summary": summary, "worlds": worlds });
    if summary.versions.len() > 1 {
        let found = summary.versions.join(", ");
        output.warn(&[format!("the worlds were judged of several builds: {found}")]);
    }
    if summary.faults() == 0 {
        return output.print(&answer, || text::summary(&summary));
    }
    if !output.is_json() {
        output.print(&answer, || text::summary(&summary))?;
    }
    let error = anyhow!(
        "worlds: expected every world right or refused, found {} of {} silent or broken",
        summary.faults(),
        worlds.len()
    );
    Err(Failure::Partly(error, answer))
}

impl Run<'_> {
    /// All worlds in the order of their numbers.
    fn all(&self) -> Result<Vec<World>, Failure> {
        let last = self.args.first + self.args.count;
        let next = AtomicU64::new(self.args.first);
        let found: Mutex<Vec<World>> = Mutex::default();
        let work = || -> Result<(), Failure> {
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                if index >= last {
                    return Ok(());
                }
                match self.of_rig(index) {
                    Ok(worlds) => lock(&found).extend(worlds),
                    Err(failure) => {
                        // The others end after the world that they are in.
                        next.store(last, Ordering::Relaxed);
                        return Err(failure);
                    }
                }
            }
        };
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..self.args.jobs).map(|_| scope.spawn(work)).collect();
            let join = |worker: std::thread::ScopedJoinHandle<'_, _>| {
                worker
                    .join()
                    .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            workers.into_iter().try_for_each(join)
        })?;
        let mut worlds = std::mem::take(&mut *lock(&found));
        worlds.sort_by_key(|world| (world.rig.index, world.request.index));
        Ok(worlds)
    }

    /// The worlds of rig number `index`.
    fn of_rig(&self, index: u64) -> Result<Vec<World>, Failure> {
        let rig = DrawnRig::draw(self.args.seed, index, &self.presets, self.args.kind);
        let requests: Vec<DrawnRequest> = (0..self.args.requests).map(|one| rig.request(one)).collect();
        // Lives as long as the worlds.
        let (_scratch, folder) = if let Some(out) = &self.args.out {
            (None, std::path::absolute(out)?.join(format!("rig-{index:04}")))
        } else {
            let scratch = tempfile::Builder::new().prefix("rcg-worlds-").tempdir()?;
            let folder = scratch.path().to_owned();
            (Some(scratch), folder)
        };
        let held: Vec<Option<World>> = requests
            .iter()
            .map(|request| self.held(&folder, &rig, request))
            .collect::<Result<_, Failure>>()?;
        let chain = Chain {
            program: &self.program,
            threads: self.threads,
            sizes: self.sizes,
            rig: &rig,
            folder,
        };
        let mut began = Instant::now();
        let mut calibrated = Ok(());
        if held.iter().any(Option::is_none) {
            fs::create_dir_all(&chain.folder)?;
            remove(&chain.folder.join("calibration"))?;
            calibrated = match chain.calibrate() {
                Ok(()) => Ok(()),
                Err(Stop::Ended(outcome)) => Err(outcome),
                Err(Stop::Failed(failure)) => return Err(failure),
            };
        }
        let mut worlds = Vec::new();
        for (request, held) in requests.into_iter().zip(held) {
            let world = if let Some(world) = held {
                world
            } else {
                let folder = world_folder(&chain.folder, &request);
                remove(&folder)?;
                fs::create_dir_all(&folder)?;
                let (outcome, files) = match &calibrated {
                    Ok(()) => chain.measure(&request, &folder)?,
                    Err(outcome) => (outcome.clone(), Vec::new()),
                };
                let world = self.world(&rig, request, outcome, files, began.elapsed().as_secs_f64());
                began = Instant::now();
                let bytes = serde_json::to_vec_pretty(&world).map_err(std::io::Error::from)?;
                write_whole(&folder.join(WORLD), &bytes)?;
                world
            };
            let ended = self.ended.fetch_add(1, Ordering::Relaxed) + 1;
            let all = self.args.count * self.args.requests;
            self.output
                .remark(&format!("{ended}/{all} {}", text::line(&world)));
            for line in text::faults(&world) {
                self.output.remark(&line);
            }
            worlds.push(world);
        }
        Ok(worlds)
    }

    fn world(
        &self,
        rig: &DrawnRig,
        request: DrawnRequest,
        outcome: Outcome,
        files: Vec<File>,
        elapsed_s: f64,
    ) -> World {
        World {
            version: self.version.clone(),
            sizes: self.sizes,
            rig: rig.clone(),
            request,
            outcome,
            files,
            elapsed_s,
        }
    }

    /// The world of `request` that ended before, if there is one in the folder of `rig`.
    fn held(&self, folder: &Path, rig: &DrawnRig, request: &DrawnRequest) -> Result<Option<World>, Failure> {
        let path = world_folder(folder, request).join(WORLD);
        let Ok(bytes) = fs::read(&path) else {
            return Ok(None);
        };
        let drawn = self.world(rig, request.clone(), Outcome::Right, Vec::new(), 0.0);
        let found = match serde_json::from_slice::<World>(&bytes) {
            Ok(world) if world.is_same(&drawn) => return Ok(Some(world)),
            Ok(_) => "one of another seed, kind or size".to_owned(),
            Err(error) => error.to_string(),
        };
        Err(Failure::input(format!(
            "{}: expected the world that is drawn, found {found}",
            path.display()
        )))
    }
}

fn world_folder(folder: &Path, request: &DrawnRequest) -> PathBuf {
    folder.join(format!("world-{}", request.index))
}

/// Removes a folder that an interrupted run left, if there is one.
fn remove(folder: &Path) -> Result<(), Failure> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error.into()),
        _ => Ok(()),
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}
