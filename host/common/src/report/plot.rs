//! Pictures for reports: lines, spectra with labelled lines, fits with residuals, stems and heat maps, as SVG text.
//!
//! Sizes are in SVG units (960 wide); the report scales them to the page. Series with more points than the
//! picture has columns are drawn by their extremes per column, so no peak is lost and files stay small.

use super::hover::Hover;
use crate::{Error, Result};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;

const WIDTH: u32 = 960;
const INK: RGBColor = RGBColor(27, 31, 36);
const GRID: RGBColor = RGBColor(226, 230, 235);
/// Okabe-Ito colours, darkest contrasts first.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(27, 31, 36),
];

/// Colour of series `index`, repeating after seven.
pub fn colour(index: usize) -> RGBColor {
    COLOURS[index % COLOURS.len()]
}

/// A named series of points.
#[derive(Debug, Clone)]
pub struct Series {
    /// Legend entry.
    pub name: String,
    /// Points in ascending x; points that are not finite are left out.
    pub points: Vec<(f64, f64)>,
}

impl Series {
    /// A series from points.
    pub fn new(name: &str, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), points }
    }

    fn finite(&self) -> Vec<(f64, f64)> {
        self.points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect()
    }
}

/// A label at a point of a spectrum.
#[derive(Debug, Clone)]
pub struct Label {
    /// Position on the x axis.
    pub x: f64,
    /// Text, short.
    pub text: String,
}

/// Axis captions.
#[derive(Debug, Clone, Copy)]
pub struct Axes<'a> {
    /// Caption of the x axis with its unit.
    pub x: &'a str,
    /// Caption of the y axis with its unit.
    pub y: &'a str,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn draw(
    height: u32,
    paint: impl FnOnce(&Area) -> std::result::Result<(), Box<dyn std::error::Error>>,
) -> Result<String> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (WIDTH, height)).into_drawing_area();
        let painted = paint(&area).and_then(|()| area.present().map_err(Into::into));
        painted.map_err(|error| Error::impossible("picture", error))?;
    }
    // The page scales the picture: a view box instead of fixed sizes.
    let fixed = format!("<svg width=\"{WIDTH}\" height=\"{height}\"");
    Ok(svg.replacen(&fixed, "<svg role=\"img\"", 1))
}

fn range(values: impl Iterator<Item = f64>, margin: f64) -> Range<f64> {
    let (low, high) =
        values.filter(|v| v.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    let width = if high > low { high - low } else { high.abs().max(1.0) };
    low - margin * width..high + margin * width
}

/// Extremes per column of the picture.
fn thinned(points: &[(f64, f64)], x: &Range<f64>) -> Vec<(f64, f64)> {
    let columns = f64::from(WIDTH);
    if points.len() < 4 * WIDTH as usize {
        return points.to_vec();
    }
    let column = |p: &(f64, f64)| ((p.0 - x.start) / (x.end - x.start) * columns) as i64;
    let mut out = Vec::new();
    for part in points.chunk_by(|a, b| column(a) == column(b)) {
        let by = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (low, high) = (part.iter().min_by(by), part.iter().max_by(by));
        let mut pair: Vec<(f64, f64)> = low.into_iter().chain(high).copied().collect();
        pair.sort_by(|a, b| a.0.total_cmp(&b.0));
        out.extend(pair);
    }
    out
}

/// Highest value per column: what a spectrum shows; the deep gaps between bins would only fill the picture.
fn envelope(points: &[(f64, f64)], x: &Range<f64>) -> Vec<(f64, f64)> {
    let columns = f64::from(WIDTH);
    let column = |p: &(f64, f64)| ((p.0 - x.start) / (x.end - x.start) * columns) as i64;
    let parts = points.chunk_by(|a, b| column(a) == column(b));
    parts.filter_map(|part| part.iter().max_by(|a, b| a.1.total_cmp(&b.1)).copied()).collect()
}

/// Room above the data for a legend, where there is one.
fn headroom(y: Range<f64>, series: usize) -> Range<f64> {
    let room = if series > 1 { 0.06 + 0.06 * series as f64 } else { 0.0 };
    y.start..y.end + room * (y.end - y.start)
}

/// Number text without needless digits.
fn tick(value: f64) -> String {
    let size = value.abs();
    if size < 1e-12 {
        return "0".into();
    }
    if !(1e-3..1e6).contains(&size) {
        return format!("{value:.1e}");
    }
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

/// A value with the unit that stands after the comma of its axis' caption, or as that caption says ("dB re 1 g").
fn value(value: f64, caption: &str) -> String {
    let unit = caption.rsplit_once(", ").map_or(caption, |(_, unit)| unit);
    let digits = if value.abs() >= 1e3 { 1 } else { 4 };
    format!("{value:.digits$} {unit}")
}

macro_rules! chart {
    ($area:expr, $x:expr, $y:expr, $axes:expr, $top:expr) => {{
        let mut chart = ChartBuilder::on($area)
            .margin(8)
            .margin_top($top)
            .margin_right(20)
            .x_label_area_size(44)
            .y_label_area_size(84)
            .build_cartesian_2d($x, $y)?;
        chart
            .configure_mesh()
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .axis_style(INK.mix(0.5))
            .label_style(("sans-serif", 14, &INK))
            .axis_desc_style(("sans-serif", 15, &INK))
            .x_desc($axes.x)
            .y_desc($axes.y)
            .x_label_formatter(&|v| tick(*v))
            .y_label_formatter(&|v| tick(*v))
            .x_labels(10)
            .y_labels(7)
            .draw()?;
        chart
    }};
}

macro_rules! legend {
    ($chart:expr, $count:expr) => {
        if $count > 1 {
            $chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .background_style(WHITE.mix(0.85))
                .border_style(GRID)
                .label_font(("sans-serif", 14, &INK))
                .draw()?;
        }
    };
}

/// Lines over a common x axis.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn lines(series: &[Series], axes: Axes) -> Result<String> {
    let data: Vec<Vec<(f64, f64)>> = series.iter().map(Series::finite).collect();
    let x = range(data.iter().flatten().map(|p| p.0), 0.0);
    let y = range(data.iter().flatten().map(|p| p.1), 0.05);
    draw(380, |area| {
        let mut chart = chart!(area, x.clone(), headroom(y, series.len()), axes, 12);
        for (i, (series, points)) in series.iter().zip(&data).enumerate() {
            let style = colour(i).stroke_width(2);
            chart
                .draw_series(LineSeries::new(thinned(points, &x), style))?
                .label(&series.name)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], style));
        }
        legend!(chart, series.len());
        Ok(())
    })
}

/// Amplitude spectra in dB re `reference`, with labelled lines and the range limited to `span_db` below the top.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn spectrum(series: &[Series], labels: &[Label], reference: f64, span_db: f64, axes: Axes) -> Result<String> {
    let decibel = |y: f64| 20.0 * (y.abs().max(f64::MIN_POSITIVE) / reference).log10();
    let data: Vec<Vec<(f64, f64)>> =
        series.iter().map(|s| s.finite().into_iter().map(|(x, y)| (x, decibel(y))).collect()).collect();
    let x = range(data.iter().flatten().map(|p| p.0), 0.0);
    let top = data.iter().flatten().map(|p| p.1).fold(f64::NEG_INFINITY, f64::max);
    let top = if top.is_finite() { top } else { 0.0 };
    // Room for labels, and for a legend where there is one.
    let room = 0.16 + if series.len() > 1 { 0.06 * series.len() as f64 } else { 0.0 };
    let (low, high) = (top - span_db, top + room * span_db);
    let mut hover = Hover::default();
    let svg = draw(420, |area| {
        let mut chart = chart!(area, x.clone(), low..high, axes, 12);
        for (i, (series, points)) in series.iter().zip(&data).enumerate() {
            let style = colour(i).stroke_width(1);
            let points: Vec<(f64, f64)> = envelope(points, &x).into_iter().map(|(x, y)| (x, y.max(low))).collect();
            chart
                .draw_series(LineSeries::new(points, style))?
                .label(&series.name)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], style.stroke_width(2)));
        }
        // Labels sit on their own line; where two would collide the later one moves up.
        let step = x.end - x.start;
        let mut placed: Vec<(f64, f64)> = Vec::new();
        for label in labels.iter().filter(|l| x.contains(&l.x)) {
            let peak = data.iter().map(|points| height_at(points, label.x)).fold(low, f64::max);
            let mut at = peak + 0.03 * span_db;
            while placed.iter().any(|p| (p.0 - label.x).abs() < 0.045 * step && (p.1 - at).abs() < 0.045 * span_db) {
                at += 0.045 * span_db;
            }
            placed.push((label.x, at));
            chart.draw_series([Circle::new((label.x, peak), 3, COLOURS[1].filled())])?;
            let said = format!("{}: {} at {}", label.text, value(peak, axes.y), value(label.x, axes.x));
            hover.add(chart.backend_coord(&(label.x, peak)), said);
            // Long texts at the borders stay inside.
            let place = (label.x - x.start) / step;
            let side = match label.text.chars().count() {
                9.. if place < 0.15 => plotters::style::text_anchor::HPos::Left,
                9.. if place > 0.85 => plotters::style::text_anchor::HPos::Right,
                _ => plotters::style::text_anchor::HPos::Center,
            };
            let anchor = plotters::style::text_anchor::Pos::new(side, plotters::style::text_anchor::VPos::Bottom);
            let style = ("sans-serif", 13, &INK).into_text_style(area).pos(anchor);
            chart.draw_series([Text::new(label.text.clone(), (label.x, at), style)])?;
        }
        legend!(chart, series.len());
        Ok(())
    })?;
    Ok(hover.onto(svg))
}

/// Points on each side of a place of a spectrum that are the line there.
const LINE_POINTS: usize = 2;

/// Height of the line at a place of ascending points.
fn height_at(points: &[(f64, f64)], x: f64) -> f64 {
    let after = points.partition_point(|point| point.0 < x);
    let own = points
        .get(after.saturating_sub(LINE_POINTS + 1)..(after + LINE_POINTS + 1).min(points.len()))
        .unwrap_or_default();
    own.iter().map(|point| point.1).fold(f64::NEG_INFINITY, f64::max)
}

/// Measured points, a fitted curve, and the residual in a panel below.
///
/// `fit` is sampled finely; `residuals` belongs to the points (same x).
///
/// # Errors
/// A picture that cannot be drawn.
pub fn fit_with_residual(
    points: &Series,
    fit: &Series,
    residuals: &[(f64, f64)],
    axes: Axes,
    residual: &str,
) -> Result<String> {
    let (measured, curve) = (points.finite(), fit.finite());
    let x = range(measured.iter().chain(&curve).map(|p| p.0), 0.03);
    let y = range(measured.iter().chain(&curve).map(|p| p.1), 0.06);
    let reach = residuals.iter().map(|p| p.1.abs()).filter(|v| v.is_finite()).fold(0.0, f64::max).max(1e-12) * 1.15;
    let mut hover = Hover::default();
    let svg = draw(540, |area| {
        let (upper, lower) = area.split_vertically(370);
        let mut chart = chart!(&upper, x.clone(), headroom(y, 2), Axes { x: "", ..axes }, 12);
        let style = colour(0).stroke_width(2);
        chart
            .draw_series(LineSeries::new(curve, style))?
            .label(&fit.name)
            .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], style));
        chart
            .draw_series(measured.iter().map(|&p| Circle::new(p, 4, colour(1).filled())))?
            .label(&points.name)
            .legend(|(x, y)| Circle::new((x + 9, y), 4, colour(1).filled()));
        for p in &measured {
            hover.add(
                chart.backend_coord(p),
                format!("{}: {} at {}", points.name, value(p.1, axes.y), value(p.0, axes.x)),
            );
        }
        legend!(chart, 2);
        let mut chart = chart!(&lower, x.clone(), -reach..reach, Axes { x: axes.x, y: residual }, 4);
        chart.draw_series(LineSeries::new([(x.start, 0.0), (x.end, 0.0)], INK.mix(0.6)))?;
        chart.draw_series(residuals.iter().map(|&p| Circle::new(p, 4, colour(1).filled())))?;
        Ok(())
    })?;
    Ok(hover.onto(svg))
}

/// Points with curves through and above them.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn scatter(points: &Series, curves: &[Series], axes: Axes) -> Result<String> {
    let (dots, lines): (_, Vec<_>) = (points.finite(), curves.iter().map(Series::finite).collect());
    let all = || dots.iter().chain(lines.iter().flatten());
    let x = range(all().map(|p| p.0), 0.02);
    let y = range(all().map(|p| p.1), 0.06);
    draw(380, |area| {
        let mut chart = chart!(area, x.clone(), headroom(y, 1 + lines.len()), axes, 12);
        for (i, (series, line)) in curves.iter().zip(lines).enumerate() {
            let style = colour(i + 1).stroke_width(2);
            chart
                .draw_series(LineSeries::new(line, style))?
                .label(&series.name)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], style));
        }
        // On top: where the points lie close to a curve it would hide them.
        let style = colour(0).mix(0.6).filled();
        chart
            .draw_series(dots.iter().map(|&p| Circle::new(p, 3, style)))?
            .label(&points.name)
            .legend(|(x, y)| Circle::new((x + 9, y), 3, colour(0).filled()));
        legend!(chart, 1 + curves.len());
        Ok(())
    })
}

/// Stems from zero: line tables, orders, coefficients.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn stems(series: &[Series], axes: Axes) -> Result<String> {
    let data: Vec<Vec<(f64, f64)>> = series.iter().map(Series::finite).collect();
    let x = range(data.iter().flatten().map(|p| p.0), 0.03);
    let y = range(data.iter().flatten().map(|p| p.1).chain([0.0]), 0.05);
    let mut hover = Hover::default();
    let svg = draw(380, |area| {
        let mut chart = chart!(area, x.clone(), headroom(y, series.len()), axes, 12);
        chart.draw_series(LineSeries::new([(x.start, 0.0), (x.end, 0.0)], INK.mix(0.6)))?;
        for (i, (series, points)) in series.iter().zip(&data).enumerate() {
            let style = colour(i).stroke_width(2);
            for p in points {
                let said = format!("{}: {} at {}", series.name, value(p.1, axes.y), value(p.0, axes.x));
                hover.add(chart.backend_coord(p), said);
            }
            chart.draw_series(points.iter().map(|&(x, y)| PathElement::new(vec![(x, 0.0), (x, y)], style)))?;
            chart
                .draw_series(points.iter().map(|&p| Circle::new(p, 4, colour(i).filled())))?
                .label(&series.name)
                .legend(move |(x, y)| Circle::new((x + 9, y), 4, colour(i).filled()));
        }
        legend!(chart, series.len());
        Ok(())
    })?;
    Ok(hover.onto(svg))
}

/// A grid of values, light to dark blue; `values[row][column]`, row 0 at the bottom, cells spread over the ranges.
///
/// # Errors
/// Rows of unequal length, or a picture that cannot be drawn.
pub fn heat_map(values: &[Vec<f64>], x: Range<f64>, y: Range<f64>, axes: Axes) -> Result<String> {
    let (rows, columns) = (values.len(), values.first().map_or(0, Vec::len));
    if rows == 0 || columns == 0 || values.iter().any(|row| row.len() != columns) {
        return Err(Error::impossible("picture", "a heat map needs equal rows"));
    }
    let scale = range(values.iter().flatten().copied(), 0.0);
    let (dx, dy) = ((x.end - x.start) / columns as f64, (y.end - y.start) / rows as f64);
    let svg = draw(440, |area| {
        let (left, right) = area.split_horizontally(WIDTH - 110);
        let mut chart = chart!(&left, x.clone(), y.clone(), axes, 12);
        let cells = values.iter().enumerate().flat_map(|(r, row)| row.iter().enumerate().map(move |(c, v)| (r, c, *v)));
        chart.draw_series(cells.map(|(r, c, value)| {
            let corner = (x.start + c as f64 * dx, y.start + r as f64 * dy);
            Rectangle::new([corner, (corner.0 + dx, corner.1 + dy)], shade(value, &scale).filled())
        }))?;
        scale_bar(&right, &scale)
    })?;
    // Without antialiasing neighbouring cells meet without seams.
    Ok(svg.replace("<rect ", "<rect shape-rendering=\"crispEdges\" "))
}

/// The colours of a map with their values.
fn scale_bar(area: &Area, scale: &Range<f64>) -> std::result::Result<(), Box<dyn std::error::Error>> {
    let mut bar = ChartBuilder::on(area)
        .margin(8)
        .margin_top(12)
        .margin_bottom(52)
        .y_label_area_size(58)
        .build_cartesian_2d(0.0..1.0, scale.clone())?;
    bar.configure_mesh()
        .disable_x_mesh()
        .disable_y_mesh()
        .disable_x_axis()
        .label_style(("sans-serif", 14, &INK))
        .y_label_formatter(&|v| tick(*v))
        .draw()?;
    let step = (scale.end - scale.start) / 64.0;
    bar.draw_series((0..64).map(|i| {
        let from = scale.start + step * f64::from(i);
        Rectangle::new([(0.0, from), (1.0, from + step)], shade(from + 0.5 * step, scale).filled())
    }))?;
    Ok(())
}

/// As [`heat_map`] for grids of any size: the cells are one embedded bitmap (no vector shapes), values below `scale`
/// are shown as its start.
///
/// # Errors
/// Rows of unequal length, or a picture that cannot be drawn.
pub fn dense_map(values: &[Vec<f64>], x: Range<f64>, y: Range<f64>, scale: Range<f64>, axes: Axes) -> Result<String> {
    let (rows, columns) = (values.len(), values.first().map_or(0, Vec::len));
    if rows == 0 || columns == 0 || values.iter().any(|row| row.len() != columns) {
        return Err(Error::impossible("picture", "a map needs equal rows"));
    }
    let mut place = None;
    let svg = draw(440, |area| {
        let (left, right) = area.split_horizontally(WIDTH - 110);
        let chart = chart!(&left, x, y, axes, 12);
        place = Some(chart.plotting_area().get_pixel_range());
        scale_bar(&right, &scale)
    })?;
    let (across, down) = place.ok_or_else(|| Error::impossible("picture", "has no plotting area"))?;
    let pixels = values.iter().rev().flatten().map(|value| {
        let RGBColor(red, green, blue) = shade(*value, &scale);
        [red, green, blue]
    });
    let image = format!(
        "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" \
         style=\"image-rendering:pixelated\" href=\"{}\"/>\n</svg>",
        across.start,
        down.start,
        across.end - across.start,
        down.end - down.start,
        super::raster::data_uri(columns as u32, rows as u32, pixels)?
    );
    Ok(svg.replace("<rect ", "<rect shape-rendering=\"crispEdges\" ").replacen("</svg>", &image, 1))
}

/// White over blue to near black: lightness falls steadily, so it also reads in grey.
fn shade(value: f64, scale: &Range<f64>) -> RGBColor {
    const STOPS: [[f64; 3]; 4] = [[247.0, 251.0, 255.0], [133.0, 188.0, 220.0], [0.0, 114.0, 178.0], [8.0, 29.0, 68.0]];
    if !value.is_finite() {
        return RGBColor(220, 220, 220);
    }
    let at = ((value - scale.start) / (scale.end - scale.start)).clamp(0.0, 1.0) * 3.0;
    let i = (at as usize).min(2);
    let mix = |c: usize| (STOPS[i][c] + (at - i as f64) * (STOPS[i + 1][c] - STOPS[i][c])) as u8;
    RGBColor(mix(0), mix(1), mix(2))
}
