//! What went wrong, and the exit code that says of what kind it is.

use std::io;

use rcg::base::blame::Blame;

/// A failed command.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The user's input is wrong: exit 2.
    Input(anyhow::Error),
    /// Something failed: exit 1.
    Failed(anyhow::Error),
    /// Something failed, and this is how far it got: exit 1.
    Partly(anyhow::Error, serde_json::Value),
}

impl Failure {
    /// Wrong input in one sentence.
    pub(crate) fn input(sentence: impl std::fmt::Display) -> Self {
        Self::Input(anyhow::anyhow!("{sentence}"))
    }

    /// The same failure of the thing at `place`, which its sentence names.
    pub(crate) fn at(self, place: impl std::fmt::Display) -> Self {
        let (place, sentence) = (place.to_string(), self.to_string());
        if sentence.contains(&place) {
            return self;
        }
        self.saying(format!("{place}: {sentence}"))
    }

    /// The same failure in another sentence.
    pub(crate) fn saying(self, sentence: String) -> Self {
        let error = anyhow::anyhow!(sentence);
        match self {
            Self::Input(_) => Self::Input(error),
            Self::Failed(_) => Self::Failed(error),
            Self::Partly(_, facts) => Self::Partly(error, facts),
        }
    }

    /// The exit code.
    pub(crate) const fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Failed(_) | Self::Partly(..) => 1,
        }
    }

    const fn error(&self) -> &anyhow::Error {
        match self {
            Self::Input(error) | Self::Failed(error) | Self::Partly(error, _) => error,
        }
    }

    /// What is to be printed with `--json` beside the error; an object or null.
    pub(crate) fn facts(&self) -> serde_json::Value {
        match self {
            Self::Partly(_, facts) => facts.clone(),
            _ => serde_json::Value::Null,
        }
    }

    /// Whether the reader of our output has gone, which is no failure.
    pub(crate) fn is_broken_pipe(&self) -> bool {
        let io = self.error().downcast_ref::<io::Error>();
        io.is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.error())
    }
}

impl<E: Blame + Send + Sync + 'static> From<E> for Failure {
    fn from(error: E) -> Self {
        if error.is_input() {
            Self::Input(error.into())
        } else {
            Self::Failed(error.into())
        }
    }
}
