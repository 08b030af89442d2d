//! The plot: frame times along the path of the last source of mirror images, and frames per second over the number of reflectors (figure 6.20 of the thesis).

use std::error::Error;

use plotters::prelude::*;

use super::series::{Series, mean};
use crate::report;

/// Size of the drawing in pixels.
const SIZE: (u32, u32) = (960, 420);
/// Width of its left part.
const LEFT: u32 = 580;
/// Font of all labels: that of the viewer.
const FONT: (&str, u32) = ("sans-serif", 13);

/// Draws the frames of these numbers as an SVG document; all series of a source stand beside each other. Errors say what the drawing library reports.
pub fn draw(numbers: &[usize], series: &[Series]) -> Result<String, String> {
    let mut text = String::new();
    panels(&mut text, numbers, series).map_err(|error| error.to_string())?;
    Ok(text)
}

fn panels(text: &mut String, numbers: &[usize], series: &[Series]) -> Result<(), Box<dyn Error>> {
    let root = SVGBackend::with_string(text, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let (left, right) = root.split_horizontally(LEFT);
    let first = numbers.first().copied().unwrap_or(0) as f64;
    let last = (numbers.last().copied().unwrap_or(0) as f64).max(first + 1.0);
    let sources: Vec<&[Series]> = series.chunk_by(|a, b| a.source == b.source).collect();
    let along = sources.last().copied().unwrap_or_default();
    let longest = along.iter().flat_map(Series::seconds).fold(1e-3, f64::max);
    let caption = format!("frame time along the path, {}", along.first().map_or("", |s| s.source.name()));
    let mut chart = ChartBuilder::on(&left)
        .caption(caption, FONT)
        .margin(8)
        .x_label_area_size(36)
        .y_label_area_size(56)
        .build_cartesian_2d(first..last, 0.0..1.05e3 * longest)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_label_formatter(&|n| format!("{n:.0}"))
        .x_desc("frame")
        .y_desc("ms")
        .label_style(FONT)
        .draw()?;
    for (i, of_count) in along.iter().enumerate() {
        let color = color(i, along.len());
        let points = numbers.iter().zip(of_count.seconds()).map(|(&number, seconds)| (number as f64, 1e3 * seconds));
        let line = chart.draw_series(LineSeries::new(points, color.stroke_width(2)))?;
        let name = match of_count.reflectors {
            1 => String::from("1 reflector"),
            n => format!("{n} reflectors"),
        };
        line.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerMiddle)
        .background_style(WHITE.mix(0.8))
        .label_font(FONT)
        .draw()?;

    let ends = [series.first(), series.last()].map(|s| s.map_or(0.0, |s| f64::from(s.reflectors)));
    let mut rates = Vec::new();
    for (of_source, source_color) in sources.iter().zip([BLACK, RED]) {
        let name = of_source.first().map_or("", |s| s.source.name());
        let mut add = |kind: &str, color: RGBAColor, of: fn(&[f64]) -> f64| {
            let rate = |s: &Series| (f64::from(s.reflectors), 1.0 / of(&s.seconds()).max(1e-9));
            rates.push((format!("{name}, {kind}"), color, of_source.iter().map(rate).collect::<Vec<_>>()));
        };
        add("mean", source_color.to_rgba(), mean);
        add("median", source_color.mix(0.4), report::median);
    }
    let highest = rates.iter().flat_map(|(_, _, points)| points).map(|(_, rate)| *rate).fold(1e-3, f64::max);
    let mut chart = ChartBuilder::on(&right)
        .caption("frames per second", FONT)
        .margin(8)
        .x_label_area_size(36)
        .y_label_area_size(44)
        .build_cartesian_2d(ends[0]..ends[1].max(ends[0] + 1.0), 0.0..1.05 * highest)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_labels(along.len().clamp(2, 10))
        .x_label_formatter(&|n| format!("{n:.0}"))
        .x_desc("reflectors")
        .label_style(FONT)
        .draw()?;
    for (name, color, points) in rates {
        let line = chart.draw_series(LineSeries::new(points, color.stroke_width(2)).point_size(3))?;
        line.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerMiddle)
        .background_style(WHITE.mix(0.8))
        .label_font(FONT)
        .draw()?;
    root.present()?;
    Ok(())
}

/// From blue for the first of `count` series to red for the last.
fn color(i: usize, count: usize) -> RGBColor {
    let hue = 0.62 * (1.0 - i as f64 / (count.max(2) - 1) as f64);
    let (r, g, b) = HSLColor(hue, 0.85, 0.42).rgb();
    RGBColor(r, g, b)
}
