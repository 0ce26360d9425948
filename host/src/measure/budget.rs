//! The budget of uncertainty for people: as a line, as a table, and on the page of a report.

use crate::brdf::cause::KINDS;
use crate::brdf::{CAUSES, RegionBudget};

/// The causes that make most of the variance, mean over the regions: those of a twentieth or more, the largest first.
/// `None` without a budget.
#[must_use]
pub fn budget_line(budget: &[RegionBudget]) -> Option<String> {
    let regions = budget.len() as f64;
    let mut causes: Vec<(&str, f64)> = CAUSES
        .iter()
        .enumerate()
        .map(|(cause, name)| {
            (
                *name,
                budget.iter().map(|region| region.shares[cause]).sum::<f64>() / regions,
            )
        })
        .filter(|(_, share)| *share >= 0.05)
        .collect();
    causes.sort_by(|a, b| b.1.total_cmp(&a.1));
    let named: Vec<String> = causes
        .into_iter()
        .map(|(name, share)| format!("{:.0} % {name}", 100.0 * share))
        .collect();
    (!named.is_empty()).then(|| format!("variance by {}", named.join(", ")))
}

/// What stands in the cells of a region's row.
fn cells(region: &RegionBudget) -> Vec<String> {
    let span = |[from, to]: [f64; 2]| format!("{from:.0}-{to:.0}°");
    let mut cells = vec![
        span(region.incident_deg),
        span(region.outgoing_deg),
        if region.relative.is_finite() {
            format!("{:.2} %", 100.0 * region.relative)
        } else {
            "none".to_owned()
        },
    ];
    cells.extend(region.shares.iter().map(|share| format!("{:.1}", 100.0 * share)));
    cells
}

/// Heads of the columns.
fn heads() -> Vec<String> {
    let fixed = ["θ incident", "θ outgoing", "σ/f"].map(str::to_owned);
    fixed.into_iter().chain(CAUSES.map(str::to_owned)).collect()
}

/// The budget as a table of text: the geometric mean of σ/f in each region, and the share of each cause in the variance,
/// percent.
#[must_use]
pub fn budget_text(budget: &[RegionBudget]) -> String {
    if budget.is_empty() {
        return "budget               none: the file has no budget of uncertainty\n".to_owned();
    }
    let rows: Vec<Vec<String>> = std::iter::once(heads()).chain(budget.iter().map(cells)).collect();
    "budget of uncertainty: σ over f (k = 1, geometric mean), and what each cause has of σ², percent\n"
        .to_owned()
        + &aligned(&rows)
}

/// Rows of cells in columns, numbers to the right.
pub(super) fn aligned(rows: &[Vec<String>]) -> String {
    let widths: Vec<usize> = (0..rows[0].len())
        .map(|column| {
            rows.iter()
                .map(|row| row[column].chars().count())
                .max()
                .unwrap_or(0)
        })
        .collect();
    let line = |row: &Vec<String>| {
        let padded = row
            .iter()
            .zip(&widths)
            .map(|(cell, width)| format!("{cell:>width$}"));
        padded.collect::<Vec<_>>().join("  ") + "\n"
    };
    rows.iter().map(line).collect()
}

/// The same for a page.
pub(super) fn budget_html(budget: &[RegionBudget]) -> String {
    if budget.is_empty() {
        return String::new();
    }
    let row = |cells: Vec<String>, tag: &str| {
        let cells: Vec<String> = cells
            .into_iter()
            .map(|cell| format!("<{tag}>{cell}</{tag}>"))
            .collect();
        format!("<tr>{}</tr>\n", cells.concat())
    };
    let rows: String = budget.iter().map(|region| row(cells(region), "td")).collect();
    let empty = [(); 3].map(|()| String::new()).into_iter();
    let types = KINDS.iter().map(|cause| cause.evaluation.to_owned());
    let kinds = row(empty.chain(types).collect(), "td");
    let lines = KINDS.iter().map(|cause| {
        format!(
            "<tr><th>{}</th><td>{}</td><td>type {}</td><td>shared by {}</td></tr>\n",
            cause.name, cause.quantity, cause.evaluation, cause.shared_by
        )
    });
    let legend = format!(
        "<p>Of these, type of evaluation after the GUM, and what has the error in common; all with degrees of freedom enough for a \
         coverage of 95 % by k = 2.</p>\n<table>\n{}</table>\n",
        lines.collect::<String>()
    );
    format!(
        "<h2>Budget of uncertainty</h2>\n<p>σ over f (k = 1, geometric mean), and what each cause has of σ², percent, by the polar \
         angles of light and view.</p>\n<table>\n{}{kinds}{rows}</table>\n{legend}",
        row(heads(), "th")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_causes_come_first_and_every_region_has_a_row() {
        let region = |noise: f64, blur: f64| RegionBudget {
            incident_deg: [0.0, 30.0],
            outgoing_deg: [30.0, 60.0],
            relative: 0.0123,
            shares: vec![noise, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, blur, 0.0, 0.0, 0.0],
            shared: 0.0,
        };
        let budget = [region(0.2, 0.79), region(0.4, 0.59)];
        assert_eq!(budget_line(&budget).unwrap(), "variance by 69 % blur, 30 % noise");
        let text = budget_text(&budget);
        assert_eq!(text.lines().count(), 4, "{text}");
        assert!(
            text.contains("0-30°") && text.contains("1.23 %") && text.contains("79.0"),
            "{text}"
        );
        // Heads, types and two regions, and the legend.
        let rows = 4 + CAUSES.len();
        assert_eq!(budget_html(&budget).matches("<tr>").count(), rows);
        assert_eq!((budget_line(&[]), budget_html(&[]).as_str()), (None, ""));
    }
}
