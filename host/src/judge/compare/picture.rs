//! A comparison as a chart and as a table.

use std::fmt::Write as _;
use std::path::Path;

use super::{Compared, RegionAgreement};
use crate::base::text::quoted;
use crate::judge::chart::{Axis, Chart, ChartError, Curve, Scale};

impl Compared {
    /// Bias of each region with its expanded uncertainty (k = 2), percent, by channel.
    #[must_use]
    pub fn chart(&self, title: &str) -> Chart {
        let curve = |label: String, of: &dyn Fn(&RegionAgreement) -> Option<f64>| Curve {
            band: Vec::new(),
            label,
            points: self
                .regions
                .iter()
                .enumerate()
                .map(|(number, region)| (number as f64 + 1.0, of(region).map(|share| 100.0 * share)))
                .collect(),
        };
        let mut curves: Vec<Curve> = (0..self.overall.len())
            .map(|channel| {
                curve(self.bias_of(channel), &|region| {
                    region.channels[channel].relative_bias
                })
            })
            .collect();
        // That of the first channel stands for all.
        for (label, sign) in [("+U (k = 2)", 2.0), ("-U (k = 2)", -2.0)] {
            curves.push(curve(label.to_owned(), &|region| {
                region.channels[0].standard_uncertainty.map(|u| sign * u)
            }));
        }
        let values: Vec<f64> = curves
            .iter()
            .flat_map(|curve| curve.points.iter().filter_map(|point| point.1))
            .collect();
        Chart {
            title: title.to_owned(),
            x: Axis {
                label: "region, in the order of the table".to_owned(),
                ticks: (0..=self.regions.len().div_ceil(3))
                    .map(|k| 3.0 * k as f64)
                    .collect(),
                scale: Scale::Linear,
            },
            y: Axis::covering("relative difference (%)", values.into_iter().chain([0.0])),
            legend: "second over first".to_owned(),
            marks: true,
            curves,
        }
    }

    /// What the bias of a channel is called.
    #[must_use]
    pub fn bias_of(&self, channel: usize) -> String {
        match self.channels[channel].as_str() {
            "" => "bias".to_owned(),
            label => format!("bias, {label}"),
        }
    }

    /// The table: a row per region and channel; empty where there is no figure.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut table =
            "region,theta_i_from_deg,theta_i_to_deg,theta_o_from_deg,theta_o_to_deg,azimuth,channel,band,samples,\
                         relative_bias,standard_uncertainty,e_n,relative_scatter\n"
                .to_owned();
        let figure = |figure: Option<f64>| figure.map(|figure| format!("{figure:.6e}")).unwrap_or_default();
        for (number, region) in self.regions.iter().enumerate() {
            let ([i0, i1], [o0, o1]) = (region.region.incident_deg, region.region.outgoing_deg);
            for (channel, one) in region.channels.iter().enumerate() {
                writeln!(
                    table,
                    "{},{i0},{i1},{o0},{o1},{},{channel},{},{},{},{},{},{}",
                    number + 1,
                    region.region.azimuth,
                    quoted(&self.channels[channel]),
                    one.samples,
                    figure(one.relative_bias),
                    figure(one.standard_uncertainty),
                    figure(one.e_n),
                    figure(one.relative_scatter)
                )
                .expect("strings take everything");
            }
        }
        table
    }

    /// Writes the chart (`.svg`, `.png`) or the table (`.csv`), as the name of `path` ends.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn save(&self, title: &str, path: &Path) -> Result<(), ChartError> {
        self.chart(title).save_or_table(|| self.csv(), path)
    }
}
