//! Options of measurements that choose their directions on the way.

use rcg::hemisphere::incident::Grid;
use rcg::measure::adaptive::{AdaptiveError, Begun, Goal};

use crate::failure::Failure;
use crate::request::RequestArgs;

/// How far an adaptive measurement goes.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct AdaptiveArgs {
    /// Choose the incident directions on the way, where the predicted error is largest, until --target or --budget; --grid
    /// and --step say from which directions it starts [default: 48 that are far apart]
    #[arg(long)]
    adaptive: bool,
    /// With --adaptive: stop at this predicted PSNR of f·cosθi at exposure 1, clipped to 1
    #[arg(long, value_name = "dB", requires = "adaptive", allow_hyphen_values = true)]
    target: Option<String>,
    /// With --adaptive: stop after so many captures with light
    #[arg(long, value_name = "N", requires = "adaptive")]
    budget: Option<usize>,
}

impl AdaptiveArgs {
    pub(crate) const fn is_given(&self) -> bool {
        self.adaptive
    }

    /// Whether directions are chosen on the way, if what is asked for goes together.
    pub(crate) fn check(&self, request: &RequestArgs) -> Result<bool, Failure> {
        if self.adaptive && request.is_spot_auto() {
            return Err(Failure::input(
                "--adaptive: expected a --spot in degrees, or that of the rig, found auto (`rcg plan --spot auto` says which \
                 opening it would be)",
            ));
        }
        // The parser forgets that these need --adaptive where --step stands beside them, which may exclude it.
        let of_adaptive = [
            ("--target", self.target.is_some()),
            ("--budget", self.budget.is_some()),
        ];
        match of_adaptive.iter().find(|(_, given)| *given && !self.adaptive) {
            Some((name, _)) => Err(Failure::input(format!(
                "{name}: expected --adaptive beside it, found none"
            ))),
            None => Ok(self.adaptive),
        }
    }

    /// Coarse beginning and goal; what is not given is as it was `begun`.
    pub(crate) fn asked(
        &self,
        request: &RequestArgs,
        begun: Option<&Begun>,
    ) -> Result<(Option<Grid>, Goal), Failure> {
        let start = request.given_grid()?;
        let start = start.or_else(|| begun.and_then(|begun| begun.start.clone()));
        let goal = match (begun, &self.target, self.budget) {
            (Some(begun), None, None) => begun.goal,
            (_, target, budget) => Goal::new(target.as_deref(), budget).map_err(AdaptiveError::from)?,
        };
        Ok((start, goal))
    }
}
