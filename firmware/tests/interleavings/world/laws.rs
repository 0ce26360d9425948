//! What the host is told, and what holds of it and of the box.

use rcg_protocol::{
    Command, Event, Fault, Reply, Request, Response, SessionId, State, Status, StepFlags, StepRecord, ToHost,
};

use super::{Move, Open, World};
use crate::engine::{TRIGGER, Truth};

impl World {
    /// The host gets the next message.
    pub(super) fn deliver(&mut self) -> Result<(), String> {
        let Some(message) = self.session.message().cloned() else {
            return Ok(());
        };
        self.session.message_sent();
        match message {
            ToHost::Response(response) => self.answered(&response),
            ToHost::Event(Event::Records { run, records }) => {
                records.iter().try_for_each(|record| self.recorded(run, record))
            }
            ToHost::Event(Event::Ended {
                run,
                state,
                fault,
                steps_done,
                ..
            }) => {
                law!(!self.ended.contains(&run), "run {run} ended twice");
                law!(
                    matches!(
                        state,
                        State::Done | State::Stopped | State::Aborted | State::Fault
                    ) && fault.is_some() == (state == State::Fault),
                    "run {run} ended as {state} with {fault:?}"
                );
                self.ended_with(run, state, steps_done)?;
                if state != State::Done {
                    self.series_over = Some(run);
                }
                self.ended.push(run);
                Ok(())
            }
            ToHost::Event(_) => Ok(()),
        }
    }

    fn truth(&self, run: u32) -> Result<&Truth, String> {
        let truth = self.engine.truths.get((run as usize).wrapping_sub(1));
        truth.ok_or(format!("run {run} was never armed"))
    }

    fn ended_with(&self, run: u32, state: State, steps_done: u64) -> Result<(), String> {
        let truth = self.truth(run)?;
        let whole = truth.whole();
        law!(steps_done == whole, "run {run}: {steps_done} steps for {whole}");
        let total = truth.total.unwrap_or(self.appended());
        let complete = self.session.sequencer().store().is_complete();
        law!(
            state != State::Done || (whole == total && complete),
            "run {run} is done after {whole} steps of {total}"
        );
        if let Some((_, begun)) = self.stopping.filter(|(stopping, _)| *stopping == run) {
            let more = truth.steps.len() - begun;
            law!(more <= 1, "run {run} went on for {more} steps after its stop");
        }
        Ok(())
    }

    fn answered(&mut self, response: &Response) -> Result<(), String> {
        let same = |open: &&mut Open| (open.session, open.seq) == (response.session, response.seq);
        if let Ok(Reply::Identity(identity)) = response.result {
            self.id = identity.session;
        }
        let Some(open) = self.open.iter_mut().find(same) else {
            law!(response.session != self.id, "{:?} was never asked", response.seq);
            return Ok(()); // of a session that is over
        };
        open.answered += 1;
        if let Ok(Reply::Status(Status {
            state: State::Done | State::Stopped | State::Aborted | State::Fault,
            run,
            steps_done,
            ..
        })) = response.result
        {
            let whole = self.engine.truths[run as usize - 1].whole();
            law!(
                steps_done == whole,
                "{steps_done} steps were said to be done, of {whole}"
            );
        }
        if let Ok(Reply::Armed { run }) = response.result {
            self.armed = Some(run);
        }
        if let (Request::Stop, Ok(Reply::Status(Status { run, .. }))) = (&open.request, response.result) {
            let begun = self.engine.truths[run as usize - 1].steps.len();
            self.stopping.get_or_insert((run, begun));
        }
        law!(
            open.answered <= open.sent,
            "{:?} was answered {} times",
            open.request,
            open.answered
        );
        law!(
            in_kind(&open.request, response, self.id),
            "{:?} was answered with {:?}",
            open.request,
            response.result
        );
        if self.last.as_ref().is_none_or(|last| last.seq != response.seq) {
            let seq = response.seq;
            self.open
                .retain(|open| (open.session, open.seq) != (response.session, seq));
        }
        Ok(())
    }

    fn recorded(&mut self, run: u32, record: &StepRecord) -> Result<(), String> {
        self.records += 1;
        let id = (run, record.step.0);
        law!(
            self.last_record.is_none_or(|last| last < id),
            "{id:?} was told out of order"
        );
        self.last_record = Some(id);
        let truth = self.truth(run)?;
        let begin = truth.steps.get(record.step.0 as usize);
        let Some(&begin) = begin else {
            return Err(format!("{} was never played", record.step));
        };
        let trigger = begin + TRIGGER;
        law!(
            record.trigger.0 == trigger,
            "{record:?} of a trigger at {trigger}"
        );
        let until = truth.steps.get(record.step.0 as usize + 1).map(|at| at + TRIGGER);
        let until = until.or(truth.rests).unwrap_or(u64::MAX);
        let mut exposures = truth
            .exposures
            .iter()
            .filter(|[on, _]| (trigger..=until).contains(on));
        let seen = record.strobe.map(|strobe| trigger + strobe.delay.0);
        let expected = exposures.next().map(|&[on, _]| on);
        law!(
            seen == expected,
            "{record:?}: exposed at {expected:?}, not {seen:?}"
        );
        let flagged = [StepFlags::MISSED, StepFlags::DOUBLE].map(|flag| record.flags.contains(flag));
        law!(
            flagged == [expected.is_none(), exposures.next().is_some()],
            "{record:?}: flags"
        );
        Ok(())
    }

    /// What holds always.
    pub(super) fn check(&self) -> Result<(), String> {
        if let Some(wrong) = self.engine.wrong {
            return Err(wrong.into());
        }
        let state = self.state();
        law!(
            !self.engine.is_started() || state == State::Running,
            "the outputs pulse while {state}"
        );
        law!(
            !self.engine.is_primed() || state == State::Armed,
            "the engine is primed while {state}"
        );
        let run = self.session.sequencer().run();
        law!(
            self.slow
                || self
                    .series_over
                    .is_none_or(|over| run == over || self.armed > Some(over)),
            "run {run} goes on with a series that was ended"
        );
        let counted = self.session.counters();
        law!(
            counted.frames == counted.executed + counted.repeated + counted.stale,
            "frames are not those that were executed, repeated and stale"
        );
        Ok(())
    }

    /// What holds when nothing happens by itself any more.
    pub(crate) fn check_rest(&self) -> Result<(), String> {
        let sequencer = self.session.sequencer();
        law!(!self.is_live(), "a run never ends: {}", self.state());
        let triggers: u64 = self.engine.truths.iter().map(Truth::triggers).sum();
        let lost = u64::from(self.session.counters().records_lost);
        law!(
            triggers == self.records + lost,
            "{triggers} triggers, {} records, {lost} lost",
            self.records
        );
        if !self.lossy {
            let runs: Vec<u32> = (1..=sequencer.run()).collect();
            law!(self.ended == runs, "the ends of {:?} were told of", self.ended);
            for open in &self.open {
                law!(open.answered > 0, "{:?} was not answered", open.request);
            }
        }
        Ok(())
    }

    /// A host that lost an answer asks again, and is answered.
    pub(crate) fn check_retry(mut self) -> Result<(), String> {
        let Some(last) = self.last.clone() else {
            return Ok(());
        };
        self.budget.strangers = 1;
        self.take(&Move::Poll)?; // an end that is still to be told of
        let before = self.open.iter().find(|open| open.seq == last.seq);
        let before = before.map_or(0, |open| open.answered);
        self.take(&Move::Again)?;
        while self.slow && self.session.message().is_some() {
            self.take(&Move::Take)?;
        }
        let after = self.open.iter().find(|open| open.seq == last.seq);
        let after = after.map_or(0, |open| open.answered);
        law!(after == before + 1, "{:?} was not answered again", last.request);
        Ok(())
    }
}

/// Whether `response` is what `request` asks for.
fn in_kind(request: &Request, response: &Response, id: SessionId) -> bool {
    let result = &response.result;
    if response.session != id && response.session != SessionId(0) {
        return *result == Err(Fault::StaleSession);
    }
    let refused = |of: Command| matches!(result, Err(Fault::Refused { command, .. }) if *command == of);
    let status = matches!(result, Ok(Reply::Status(_)));
    match request {
        Request::Hello { nonce } => {
            matches!(result, Ok(Reply::Identity(identity)) if identity.nonce == *nonce)
        }
        Request::Ping(number) => *result == Ok(Reply::Pong(*number)),
        Request::Load(_) => matches!(result, Ok(Reply::Room { .. })) || refused(Command::Load),
        Request::Append { .. } => matches!(result, Ok(Reply::Room { .. })) || refused(Command::Append),
        Request::Arm => matches!(result, Ok(Reply::Armed { .. })) || refused(Command::Arm),
        Request::Start => status || refused(Command::Start),
        Request::Stop => status || refused(Command::Stop),
        Request::Clear => status || refused(Command::Clear),
        Request::Watch => status || refused(Command::Watch),
        Request::Keep(_) => status || refused(Command::Keep),
        Request::Abort => {
            matches!(result, Ok(Reply::Status(now)) if !matches!(now.state, State::Armed | State::Running))
        }
        _ => status,
    }
}
