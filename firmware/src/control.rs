//! Session and pulse engine together: what the session commands is carried out, and seen through.
//!
//! # Design
//! Small pieces of work, so that a lock around both is never held for long. A command that came of one is work too:
//! whoever goes on until there is none leaves no halt behind that is not told of, and a request that comes then finds
//! the run at its end.

use rcg_protocol::{Fault, Input, Inputs, Request, Start, Stored, Ticks, ToDevice};

use crate::kept::Kept;
use crate::session::{EngineCommand, Session};

/// What plays the steps of a session.
pub trait PulseEngine {
    /// Does one small piece of work. Returns whether there may be more.
    fn turn(&mut self, session: &mut Session) -> bool;

    /// [`EngineCommand::Prime`].
    fn prime(&mut self, session: &mut Session);

    /// [`EngineCommand::Go`].
    fn go(&mut self, start: Start, session: &mut Session);

    /// [`EngineCommand::Halt`]: outputs at rest at once; turns tell of the time before that, and then that it has halted.
    fn halt(&mut self);

    /// [`EngineCommand::Watch`].
    fn watch(&mut self);

    /// [`EngineCommand::Keep`].
    fn keep(&mut self, kept: Kept);

    /// Writes `bytes` to `page` of the memory that schedules are kept in, and erases the sector first that it begins. The engine rests.
    fn store(&mut self, page: u16, bytes: &[u8]);

    /// What that memory keeps, if it is whole.
    fn stored(&mut self) -> Option<Stored>;

    /// What stands at the inputs.
    fn inputs(&mut self) -> Inputs;

    /// What stands at PHOTO.
    fn photo(&mut self) -> Input;
}

/// Passes `message` on to `session`, with what it needs to know of `engine`, and carries out what comes of it.
pub fn request(engine: &mut impl PulseEngine, session: &mut Session, now: Ticks, message: &ToDevice) {
    // Not by `==`, which would compare the steps of schedules, too, and takes as much code.
    if matches!(message.request, Request::Inputs) {
        session.seen(engine.inputs());
    }
    if matches!(message.request, Request::Photo) {
        session.photo_seen(engine.photo());
    }
    session.request(now, message);
    if let &Request::Store { page, ref bytes } = &message.request
        && session.takes_page()
    {
        engine.store(page, bytes);
        // Pages of what is not described yet are nobody's schedule.
        session.set_stored(if page == 0 { engine.stored() } else { None });
    }
    obey(engine, session);
}

/// Makes a request that was kept, and carries out what comes of it.
///
/// # Errors
/// Why it was refused.
pub fn recall(
    engine: &mut impl PulseEngine,
    session: &mut Session,
    now: Ticks,
    request: &Request,
) -> Result<(), Fault> {
    session.recall(now, request)?;
    obey(engine, session);
    Ok(())
}

/// Lets `engine` do one small piece of work, and carries out what comes of it. Returns whether there may be more.
pub fn turn(engine: &mut impl PulseEngine, session: &mut Session) -> bool {
    let more = engine.turn(session);
    obey(engine, session) || more
}

/// Carries out what `session` commands. Returns whether there was anything.
pub fn obey(engine: &mut impl PulseEngine, session: &mut Session) -> bool {
    let mut some = false;
    while let Some(command) = session.engine_action() {
        some = true;
        carry_out(engine, session, command);
    }
    some
}

#[inline(never)] // rare, and large on the stack
fn carry_out(engine: &mut impl PulseEngine, session: &mut Session, command: EngineCommand) {
    match command {
        EngineCommand::Prime => engine.prime(session),
        EngineCommand::Go(start) => engine.go(start, session),
        EngineCommand::Halt => engine.halt(),
        EngineCommand::Watch => engine.watch(),
        EngineCommand::Keep(kept) => engine.keep(kept),
    }
}
