//! The state machine of a run: idle → loaded → armed → running → done | stopped | aborted | fault.
//!
//! # Design
//! Commands are checked against one table of legal transitions; what is illegal is answered with
//! [`Fault::Refused`] that names command and state. The pulse engine (PIO and DMA, or the simulation)
//! takes step after step with [`Sequencer::next_step`] and tells how far it got; it decides nothing.

use rcg_protocol::{
    Aux, AuxPolarity, Command, Extent, Fault, Pace, Program, RunId, Start, State, Step, StepId, Ticks,
};

use crate::burst::{Burst, Haste};
use crate::pulse::{Outline, StepWords, WordFormat};
use crate::store::Store;

/// Sequencer and the schedule that it plays.
#[derive(Clone, Debug)]
pub struct Sequencer {
    state: State,
    program: Option<Program>,
    /// What further lines do in it.
    aux: Aux,
    run: RunId,
    /// Steps handed to the engine in this run.
    fetched: u64,
    /// Steps fired whole in this run.
    done: u64,
    stopping: bool,
    fault: Option<Fault>,
    /// When the run began, on the controller's clock.
    started: Option<Ticks>,
    /// Where the next fetched step begins, from the start of a free run.
    horizon: Ticks,
    haste: Haste,
    store: Store,
}

/// A step for the engine, but for its words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fetched {
    /// Its number in the run.
    pub step: StepId,
    /// How many words it has.
    pub words: usize,
    /// Start of the step from the start of the run, when free running.
    pub begins: Ticks,
    /// Leading edge of CAM from the start of the step.
    pub trigger: Option<Ticks>,
    /// Length of the step.
    pub period: Ticks,
}

impl Default for Sequencer {
    fn default() -> Self {
        Self::new()
    }
}

impl Sequencer {
    /// Idle, with nothing loaded.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: State::Idle,
            program: None,
            aux: Aux::resting(AuxPolarity {
                a_active_low: false,
                b_active_low: false,
                photo_active_low: false,
                start_active_low: false,
            }),
            store: Store::new(),
            run: 0,
            fetched: 0,
            done: 0,
            stopping: false,
            fault: None,
            started: None,
            horizon: Ticks::ZERO,
            haste: Haste::new(Ticks::ZERO),
        }
    }

    /// The same, for a CPU that needs `step_cost` for a step that it handles by itself.
    #[must_use]
    pub const fn with_step_cost(mut self, step_cost: Ticks) -> Self {
        self.set_step_cost(step_cost);
        self
    }

    /// The CPU needs `step_cost` for a step that it handles by itself. To be called before anything is loaded.
    pub const fn set_step_cost(&mut self, step_cost: Ticks) {
        self.haste = Haste::new(step_cost);
    }

    /// The state.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Number of the present or last run.
    #[must_use]
    pub const fn run(&self) -> RunId {
        self.run
    }

    /// Steps fired whole in this run.
    #[must_use]
    pub const fn steps_done(&self) -> u64 {
        self.done
    }

    /// Whether the run is to end after the current step.
    #[must_use]
    pub const fn is_stopping(&self) -> bool {
        self.stopping
    }

    /// Why the last run ended by itself.
    #[must_use]
    pub const fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// The program that is loaded or being loaded.
    #[must_use]
    pub const fn program(&self) -> Option<&Program> {
        self.program.as_ref()
    }

    /// When the present run began, on the controller's clock.
    #[must_use]
    pub const fn started(&self) -> Option<Ticks> {
        self.started
    }

    /// Layout of the words, once a program is loaded.
    #[must_use]
    pub fn format(&self) -> Option<WordFormat> {
        self.program
            .map(|p| WordFormat::new(p.pace, p.polarity).with_aux(&self.aux))
    }

    /// What the further lines do in the schedule that is loaded or being loaded.
    #[must_use]
    pub const fn aux(&self) -> &Aux {
        &self.aux
    }

    /// Steps that fit now.
    #[must_use]
    pub fn room(&self) -> u32 {
        let free = self.store.free_steps();
        match self.program.map(|p| p.extent) {
            Some(Extent::Table { steps, .. }) => {
                free.min(u64::from(steps).saturating_sub(self.store.appended()) as u32)
            }
            Some(Extent::Stream) => free,
            None => 0,
        }
    }

    /// Whether `command` is legal now, and if not, the fault that says so.
    pub(crate) fn check(&self, command: Command) -> Result<(), Fault> {
        use State::{Aborted, Armed, Done, Idle, Loaded, Running, Stopped};
        let streaming = self.program.is_some_and(|p| p.extent == Extent::Stream);
        let legal = match command {
            Command::Load
            | Command::Clear
            | Command::Watch
            | Command::Boot
            | Command::Keep
            | Command::Store => !matches!(self.state, Armed | Running),
            Command::Append => {
                self.program.is_some()
                    && !self.store.is_complete()
                    && (self.state == Idle || (streaming && matches!(self.state, Loaded | Armed | Running)))
            }
            // A table can be fired again, a stream is gone once played.
            Command::Arm => {
                self.state == Loaded
                    || (!streaming
                        && self.store.is_complete()
                        && matches!(self.state, Done | Stopped | Aborted | State::Fault))
            }
            Command::Start => self.state == Armed,
            Command::Stop => self.state == Running,
        };
        if legal {
            Ok(())
        } else {
            Err(Fault::Refused {
                command,
                state: self.state,
            })
        }
    }

    /// Forgets the schedule and begins a new one, in which further lines rest.
    ///
    /// # Errors
    /// As [`load_with`](Self::load_with).
    pub fn load(&mut self, program: Program) -> Result<(), Fault> {
        self.load_with(program, Aux::default())
    }

    /// Forgets the schedule and begins a new one, in which further lines do what `aux` says.
    ///
    /// # Errors
    /// [`Fault::Refused`], [`Fault::StartPaced`], [`Fault::EmptySchedule`], [`Fault::TooManySteps`]; the old schedule stays then.
    pub fn load_with(&mut self, program: Program, aux: Aux) -> Result<(), Fault> {
        self.check(Command::Load)?;
        if program.start == Start::OnStartLine && program.pace == Pace::EachOnSync {
            return Err(Fault::StartPaced);
        }
        if let Extent::Table { steps, cycles } = program.extent {
            if steps == 0 || cycles == 0 {
                return Err(Fault::EmptySchedule);
            }
            let limit = crate::store::MAX_STEPS as u32;
            if steps > limit {
                return Err(Fault::TooManySteps { limit });
            }
        }
        self.store.begin(program.extent);
        self.haste.clear();
        self.program = Some(program);
        self.aux = aux;
        self.state = State::Idle;
        Ok(())
    }

    /// Adds steps: all of them or, if one is bad, none.
    ///
    /// # Errors
    /// [`Fault::Refused`], [`Fault::EmptySchedule`], [`Fault::StepsOutOfOrder`], [`Fault::TooManySteps`], [`Fault::StreamFull`], or
    /// what [`WordFormat::encode`] finds wrong with a step.
    pub fn append(&mut self, first: u64, steps: &[Step], last: bool) -> Result<(), Fault> {
        self.check(Command::Append)?;
        let (Some(program), Some(format)) = (self.program, self.format()) else {
            return Err(Fault::Refused {
                command: Command::Append,
                state: self.state,
            });
        };
        let expected = self.store.appended();
        if first != expected {
            return Err(Fault::StepsOutOfOrder {
                expected,
                found: first,
            });
        }
        if last && steps.is_empty() && expected == 0 {
            return Err(Fault::EmptySchedule);
        }
        if let Extent::Table { steps: limit, .. } = program.extent
            && expected + steps.len() as u64 > u64::from(limit)
        {
            return Err(Fault::TooManySteps { limit });
        }
        for step in steps {
            let index = self.store.appended();
            let mut words = StepWords::new();
            let encoded = format.encode_into(step, &self.aux, index, &mut words);
            if let Err(fault) = encoded.and_then(|()| self.store.push(&words)) {
                self.store.retract(index - expected);
                return Err(match fault {
                    // The steps before it have been given back, so they fit too.
                    Fault::StreamFull { .. } => Fault::StreamFull {
                        free: self.store.free_steps(),
                    },
                    other => other,
                });
            }
        }
        for step in steps {
            self.haste.add(step.period);
        }
        let appended = self.store.appended();
        let full = match program.extent {
            Extent::Table { steps, .. } => appended == u64::from(steps),
            Extent::Stream => last,
        };
        if full {
            self.store.complete();
        }
        let playable = full || program.extent == Extent::Stream;
        if self.state == State::Idle && playable && appended > 0 {
            self.state = State::Loaded;
        }
        Ok(())
    }

    /// Makes ready to fire.
    ///
    /// # Errors
    /// [`Fault::Refused`].
    pub fn arm(&mut self) -> Result<RunId, Fault> {
        self.check(Command::Arm)?;
        if let Some(program) = self.program {
            self.store.rewind(program.extent);
        }
        self.run = self.run.wrapping_add(1);
        self.fetched = 0;
        self.done = 0;
        self.stopping = false;
        self.fault = None;
        self.started = None;
        self.horizon = Ticks::ZERO;
        self.state = State::Armed;
        Ok(self.run)
    }

    /// Fires.
    ///
    /// # Errors
    /// [`Fault::Refused`].
    pub fn start(&mut self) -> Result<(), Fault> {
        self.check(Command::Start)?;
        self.state = State::Running;
        Ok(())
    }

    /// Lets the run end after the current step.
    ///
    /// # Errors
    /// [`Fault::Refused`].
    pub fn stop(&mut self) -> Result<(), Fault> {
        self.check(Command::Stop)?;
        self.stopping = true;
        Ok(())
    }

    /// Ends the run at once. Returns whether there was one; the engine must halt then.
    #[must_use]
    pub fn abort(&mut self) -> bool {
        let live = matches!(self.state, State::Armed | State::Running);
        if live {
            self.state = State::Aborted;
        }
        live
    }

    /// Ends the run at once because of `fault`. Returns whether there was one.
    #[must_use]
    pub fn fail(&mut self, fault: Fault) -> bool {
        let live = matches!(self.state, State::Armed | State::Running);
        if live {
            self.state = State::Fault;
            self.fault = Some(fault);
        }
        live
    }

    /// Forgets the schedule.
    ///
    /// # Errors
    /// [`Fault::Refused`].
    pub fn clear(&mut self) -> Result<(), Fault> {
        self.check(Command::Clear)?;
        self.program = None;
        self.store.begin(Extent::Stream);
        self.state = State::Idle;
        Ok(())
    }

    /// The next step for the engine, its words handed to `take` in one piece or two; `None` if there is none now.
    /// Valid while armed and running.
    pub fn next_step(&mut self, mut take: impl FnMut(&[u32])) -> Option<Fetched> {
        if !matches!(self.state, State::Armed | State::Running) || self.stopping {
            return None;
        }
        let mut outline = Outline::new(self.format()?);
        let words = self.store.take_step(|words| {
            outline.add(words);
            take(words);
        })?;
        let fetched = Fetched {
            step: StepId(self.fetched),
            words,
            begins: self.horizon,
            trigger: outline.trigger(),
            period: outline.period(),
        };
        self.fetched += 1;
        self.horizon += fetched.period;
        Some(fetched)
    }

    /// The loaded table as a burst, if it runs free and the CPU would fall more than `slack` behind it. No step is
    /// left to [`next_step`](Self::next_step) then.
    pub fn burst(&mut self, slack: Ticks, slice_for: Ticks) -> Option<Burst> {
        let program = self.program?;
        let Extent::Table { steps, cycles } = program.extent else {
            return None;
        };
        if program.pace != Pace::FreeRunning || !self.haste.exceeds(slack) {
            return None;
        }
        let burst = Burst::new(&mut self.store, &self.haste, cycles, slice_for);
        self.store.take_table();
        self.fetched = u64::from(steps) * u64::from(cycles);
        Some(burst)
    }

    /// The words and steps of the schedule.
    #[must_use]
    pub const fn store(&self) -> &Store {
        &self.store
    }

    /// The first step begins at `at`.
    pub fn begun(&mut self, at: Ticks) {
        self.started = Some(at);
    }

    /// The engine has fired `steps` steps of this run whole.
    pub fn fired(&mut self, steps: u64) {
        self.done = steps;
    }

    /// The engine has nothing more to play. Returns the state that the run ended in.
    pub fn drained(&mut self) -> State {
        if self.state == State::Running {
            // A stop may cut off steps that were fetched already, and steps may have come too late.
            let cut = self.done < self.fetched;
            let all = self.store.is_complete() && self.store.is_dry() && !cut;
            self.state = if all {
                State::Done
            } else if self.stopping {
                State::Stopped
            } else {
                self.fault = Some(Fault::Underrun {
                    step: StepId(self.done),
                });
                State::Fault
            };
        }
        self.state
    }
}
