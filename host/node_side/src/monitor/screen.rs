//! The picture: state and quality, speed and rates, alarms, mesh bands, values, events, keys; from 80x24 upwards.
//!
//! What does not fit is left out from below, never wrapped: events first, then the order view, then sidebands. Bars
//! are decibels over `SPAN_DB` below the strongest line, because a tenth of the strongest line is not yet nothing.

use super::capture::Capture;
use super::link::Standing;
use super::panel::{Panel, SILENT_S, Trend, VALUES};
use crate::link::alarms::Alarms;
use crate::link::text::{SIDE_SHARE, gear_line};
use crate::link::words::{event, seconds, words};
use crate::link::{Losses, health};
use meshband::message::{SpectralLine, Spectrum, Status};
use meshband::node::State;
use meshband::tach::Validity;
use meshband::waveform::CapturePhase;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Paragraph};

/// Decibels that a full bar spans.
const SPAN_DB: f64 = 60.0;
/// Signs of a trend, from low to high.
const STEPS: [&str; 8] = ["▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"];
/// Strongest lines shown where there is room.
const MAX_LINES: usize = 8;
/// Age from which on a figure is drawn faint, s.
const OLD_S: f64 = 10.0;

/// What is drawn beside the panel.
pub struct Scene<'a> {
    /// Everything the node said.
    pub panel: &'a Panel,
    /// How the link stands.
    pub standing: &'a Standing,
    /// What was lost.
    pub losses: Losses,
    /// Capture, where one is kept.
    pub capture: Option<&'a Capture>,
    /// Seconds since the start.
    pub now_s: f64,
    /// Events are shown as a list.
    pub events_open: bool,
    /// Help covers the picture.
    pub help: bool,
}

/// Draws everything.
pub fn draw(frame: &mut Frame, scene: &Scene) {
    let area = frame.area();
    let wide = area.width >= 120;
    let alarms = alarm_lines(scene).len().clamp(1, 4) as u16;
    let values_rows = if wide { VALUES.len() as u16 } else { VALUES.len().div_ceil(2) as u16 };
    let bands = band_rows_of(scene);
    let events = if scene.events_open { area.height / 3 } else { 1 };
    let fixed = 3 + alarms + 1;
    let spare = area.height.saturating_sub(fixed + events);
    let (band_rows, value_rows) = if wide {
        (spare, spare)
    } else {
        let value_rows = (values_rows + 1).min(spare.saturating_sub(2));
        ((bands + 2).min(spare.saturating_sub(value_rows)), value_rows)
    };
    let middle = if wide { spare } else { band_rows + value_rows };
    let [head, alarm_area, middle_area, event_area, foot] = Layout::vertical([
        Constraint::Length(3),
        Constraint::Length(alarms),
        Constraint::Length(middle),
        Constraint::Min(events),
        Constraint::Length(1),
    ])
    .areas(area);
    frame.render_widget(Paragraph::new(header(scene, area.width)), head);
    frame.render_widget(Paragraph::new(alarm_lines(scene)), alarm_area);
    if wide {
        draw_wide(frame, middle_area, scene);
    } else {
        let [bands_area, values_area] =
            Layout::vertical([Constraint::Length(band_rows), Constraint::Length(value_rows)]).areas(middle_area);
        frame.render_widget(
            Paragraph::new(band_lines(scene, bands_area.width)).block(titled("mesh bands, m/s2 peak", scene)),
            bands_area,
        );
        frame.render_widget(
            Paragraph::new(value_lines(scene, 2, values_area.width)).block(titled("values", scene)),
            values_area,
        );
    }
    frame.render_widget(Paragraph::new(event_lines(scene, event_area.height as usize)), event_area);
    frame.render_widget(Paragraph::new(footer(scene)), foot);
    if scene.help {
        draw_help(frame, area);
    }
}

fn draw_wide(frame: &mut Frame, area: Rect, scene: &Scene) {
    let [left, right] = Layout::horizontal([Constraint::Percentage(62), Constraint::Percentage(38)]).areas(area);
    let bands = band_rows_of(scene);
    let [top, bottom] =
        Layout::vertical([Constraint::Length((bands + 2).min(left.height)), Constraint::Min(0)]).areas(left);
    frame
        .render_widget(Paragraph::new(band_lines(scene, top.width)).block(titled("mesh bands, m/s2 peak", scene)), top);
    frame.render_widget(
        Paragraph::new(order_lines(scene, bottom)).block(titled("orders of the pinion, dB below the strongest", scene)),
        bottom,
    );
    let strongest = strongest_lines(scene);
    let [upper, lower] =
        Layout::vertical([Constraint::Min(0), Constraint::Length(strongest.len() as u16 + 1)]).areas(right);
    frame.render_widget(Paragraph::new(value_lines(scene, 1, upper.width)).block(titled("values", scene)), upper);
    frame.render_widget(Paragraph::new(strongest).block(titled("strongest lines, m/s2 peak", scene)), lower);
}

/// Rows of the mesh bands: the pinion's harmonics, then a row for each further gear of a train.
fn band_rows_of(scene: &Scene) -> u16 {
    let view = &scene.panel.view;
    (view.spectrum.as_ref().map_or(1, |s| s.bands.len()).max(1) + view.gears.len()) as u16
}

fn titled<'a>(title: &'a str, scene: &Scene) -> Block<'a> {
    // Beside the values what they rest on as a device, where the node tells it.
    let aside = match title {
        "values" => scene.panel.view.health.as_ref().map(health::short).filter(|text| !text.is_empty()),
        _ => scene.panel.spectrum_s.map(|at| format!("{} old", seconds(scene.now_s - at))),
    };
    let aside = aside.map_or(String::new(), |text| format!(" ({text}) "));
    Block::new().borders(Borders::TOP).title(format!(" {title}{aside}")).border_style(Style::new().dark_gray())
}

fn header(scene: &Scene, width: u16) -> Vec<Line<'static>> {
    let panel = scene.panel;
    let silent = panel.silent_s(scene.now_s);
    let status = panel.view.status.as_ref();
    let first = match (scene.standing, silent) {
        (Standing::Lost { reason, attempts, next_s }, _) => {
            let when = if *next_s > 0.0 { format!("again in {next_s:.0} s") } else { "connecting".into() };
            let tried = if *attempts > 0 { format!(", {attempts} failed") } else { String::new() };
            let badge = Span::styled(" LINK LOST ", Style::new().white().on_red().bold());
            Line::from(vec![badge, Span::raw(format!(" {when}{tried}: {reason}"))])
        }
        (Standing::Open, Some(silent)) => {
            let badge = Span::styled(" SILENT ", Style::new().white().on_red().bold());
            Line::from(vec![badge, Span::raw(format!(" silent for {silent:.0} s; what stands here is old"))])
        }
        (Standing::Open, None) => state_line(status, panel, scene.losses),
    };
    let faint = silent.is_some() || *scene.standing != Standing::Open;
    let style = if faint { Style::new().add_modifier(Modifier::DIM) } else { Style::new() };
    let mut lines = vec![clipped(first, width)];
    match status {
        None => lines.extend([Line::raw("no status yet"), Line::raw("")]),
        Some(s) => {
            let age = panel.status_s.map_or(String::new(), |at| format!("   {} old", seconds(scene.now_s - at)));
            lines.push(Line::styled(speed_text(s) + &age, style));
            lines.push(Line::styled(rate_text(s), style));
        }
    }
    lines
}

fn clipped(line: Line<'static>, width: u16) -> Line<'static> {
    let mut room = usize::from(width);
    let spans = line.spans.into_iter().map(|span| {
        let text: String = span.content.chars().take(room).collect();
        room -= text.chars().count();
        Span::styled(text, span.style)
    });
    Line::from(spans.collect::<Vec<_>>())
}

fn state_line(status: Option<&Status>, panel: &Panel, losses: Losses) -> Line<'static> {
    let Some(s) = status else {
        return Line::styled(" WAITING for the first status ", Style::new().black().on_yellow());
    };
    let style = match s.state {
        State::Measuring => Style::new().black().on_green().bold(),
        State::Settling => Style::new().black().on_yellow().bold(),
        State::Stopped | State::WaitingForTach => Style::new().white().on_red().bold(),
    };
    let mut notes = Vec::new();
    for (set, note) in [
        (s.law_clamped, "speed outside the law's domain"),
        (s.law_provisional, "law provisional"),
        (s.limited, "rate limited by the board"),
        (s.safe_rate, "no speed: safe maximum rate"),
        (s.validity == Validity::Doubtful, "tach doubtful"),
        (losses.lost > 0, "frames were lost"),
        (losses.refused > 0, "garbage on the link"),
    ] {
        if set {
            notes.push(note);
        }
    }
    let quality = if notes.is_empty() { "no reservation".to_owned() } else { notes.join("; ") };
    let who = panel.view.identity.as_ref().map_or(String::new(), |node| format!("   {}", node.board));
    let colour = if notes.is_empty() { Color::Green } else { Color::Yellow };
    let held = if s.capture == CapturePhase::Held { "   WAVEFORM HELD" } else { "" };
    Line::from(vec![
        Span::styled(format!(" {} ", words(&s.state).to_uppercase()), style),
        Span::styled(format!(" {quality}"), Style::new().fg(colour)),
        Span::raw(who),
        Span::styled(held, Style::new().cyan().bold()),
    ])
}

fn speed_text(s: &Status) -> String {
    format!(
        "speed {:.4} Hz = {:.1} rpm +- {:.1e}  {}  pulse {}",
        s.speed_hz,
        60.0 * s.speed_hz,
        s.speed_uncertainty,
        words(&s.validity),
        seconds(f64::from(s.age_s))
    )
}

fn rate_text(s: &Status) -> String {
    format!(
        "law {:.0} Hz   wanted {:.0} Hz   granted {:.0} Hz   ADC {:.0} Hz / {}",
        s.bandwidth_hz,
        s.requested_hz,
        s.granted_hz,
        s.adc_hz,
        1u32.checked_shl(s.stages.into()).unwrap_or(1)
    )
}

/// What stands, then what is over; with its age where the node has not confirmed it for a while.
fn alarm_lines(scene: &Scene) -> Vec<Line<'static>> {
    let panel = scene.panel;
    let alarms = Alarms::of(&panel.view);
    let old = panel.status_s.map(|at| scene.now_s - at).filter(|&age| age >= SILENT_S);
    let as_of = old.map_or(String::new(), |age| format!("{} ago, not known now: ", seconds(age)));
    let style = match (alarms.any(), old) {
        (false, _) => Style::new().dark_gray(),
        (true, Some(_)) => Style::new().red().add_modifier(Modifier::DIM),
        (true, None) if alarms.standing.iter().all(|alarm| alarm.acknowledged) && !alarms.signal_bad => {
            Style::new().red()
        }
        (true, None) => Style::new().white().on_red().bold(),
    };
    let unseen = alarms.standing.iter().any(|alarm| !alarm.acknowledged);
    let mut lines: Vec<Line> =
        alarms.lines().into_iter().map(|line| Line::styled(format!(" {as_of}{line} "), style)).collect();
    if let Some(last) = lines.last_mut().filter(|_| unseen && old.is_none()) {
        last.push_span(Span::raw("  a acknowledges"));
    }
    let over = panel.over.iter().map(|(index, at)| {
        let text = format!(" alarm {} is over since {}", index + 1, seconds(scene.now_s - at));
        Line::styled(text, Style::new().yellow())
    });
    lines.extend(over);
    lines
}

fn band_lines(scene: &Scene, width: u16) -> Vec<Line<'static>> {
    let Some(spectrum) = &scene.panel.view.spectrum else {
        let none = Line::styled("no mesh-band spectrum yet: it needs a locked speed", Style::new().dark_gray());
        return std::iter::once(none).chain(gear_lines(scene)).collect();
    };
    let strongest = spectrum.bands.iter().map(|b| b.line.amplitude).fold(f32::MIN_POSITIVE, f32::max);
    let trend_width = if width >= 100 { 30 } else { 12 };
    let bar_width = usize::from(width).saturating_sub(36 + trend_width + 22).clamp(8, 60);
    let line = |band: &meshband::message::MeshBand| {
        let trend = scene.panel.harmonics.get(&band.harmonic).map_or(String::new(), |t| sparkline(t, trend_width));
        let side = [&band.sidebands[..], &band.gear_sidebands[..]].concat();
        let side = side.iter().max_by(|a, b| a.amplitude.total_cmp(&b.amplitude));
        let side = side.filter(|line| line.amplitude > SIDE_SHARE * band.line.amplitude);
        let side = side.map_or(String::new(), |l| format!(" side {:8.1} {:8.4}", l.frequency_hz, l.amplitude));
        Line::from(vec![
            Span::raw(format!("{}x {:9.2} Hz {:9.4} ", band.harmonic, band.line.frequency_hz, band.line.amplitude)),
            Span::styled(bar(band.line.amplitude, strongest, bar_width), Style::new().cyan()),
            Span::styled(format!(" {trend:trend_width$}"), Style::new().green()),
            Span::styled(side, Style::new().dark_gray()),
        ])
    };
    spectrum.bands.iter().map(line).chain(gear_lines(scene)).collect()
}

/// A row for each further gear of a train.
fn gear_lines(scene: &Scene) -> Vec<Line<'static>> {
    let view = &scene.panel.view;
    view.gears.iter().map(|(number, gear)| Line::raw(gear_line(view, *number, gear))).collect()
}

/// A bar of decibels below the strongest.
fn bar(value: f32, strongest: f32, width: usize) -> String {
    let db = 20.0 * f64::from(value / strongest).max(1e-12).log10();
    let share = (1.0 + db / SPAN_DB).clamp(0.0, 1.0);
    let full = (share * width as f64).round() as usize;
    "█".repeat(full) + &"·".repeat(width - full)
}

fn sparkline(trend: &Trend, width: usize) -> String {
    trend.scaled(width, STEPS.len() as u64).into_iter().map(|step| STEPS[(step as usize - 1).min(7)]).collect()
}

fn value_lines(scene: &Scene, columns: usize, width: u16) -> Vec<Line<'static>> {
    let cell_width = usize::from(width) / columns;
    let trend_width = cell_width.saturating_sub(35).min(60);
    let cell = |(name, digits): (&'static str, usize)| {
        let Some(trend) = scene.panel.values.get(name) else {
            return Span::styled(
                format!("{name:<15} {:>10}{:w$}", "-", "", w = cell_width.saturating_sub(26)),
                Style::new().dark_gray(),
            );
        };
        let age = scene.now_s - trend.at_s;
        let value = trend.last().unwrap_or(f64::NAN);
        let value = if value.is_finite() { format!("{value:.digits$}") } else { "-".into() };
        let text = format!("{name:<15} {value:>10} {:<6} {}", seconds(age), sparkline(trend, trend_width));
        let style = if age > OLD_S { Style::new().add_modifier(Modifier::DIM) } else { Style::new() };
        Span::styled(format!("{text:cell_width$}"), style)
    };
    VALUES.chunks(columns).map(|row| Line::from(row.iter().map(|&v| cell(v)).collect::<Vec<_>>())).collect()
}

/// The strongest lines of the whole band, wherever they come from.
fn strongest_lines(scene: &Scene) -> Vec<Line<'static>> {
    let Some(peaks) = &scene.panel.view.peaks else {
        return vec![Line::styled("no wideband spectrum yet", Style::new().dark_gray())];
    };
    let speed = f64::from(peaks.tag.speed_hz);
    let line = |line: &SpectralLine| {
        let order =
            if speed > 0.0 { format!("order {:9.3}", f64::from(line.frequency_hz) / speed) } else { String::new() };
        Line::raw(format!("{:10.2} Hz {:10.4}   {order}", line.frequency_hz, line.amplitude))
    };
    peaks.lines.iter().take(MAX_LINES).map(line).collect()
}

/// All lines of the newest spectrum as columns over the order, the strongest of each column.
fn order_lines(scene: &Scene, area: Rect) -> Vec<Line<'static>> {
    let (width, height) = (usize::from(area.width), usize::from(area.height.saturating_sub(2)));
    let Some(spectrum) = &scene.panel.view.spectrum else { return Vec::new() };
    let lines = all_lines(spectrum);
    let speed = f64::from(spectrum.tag.speed_hz);
    let highest = lines.iter().map(|l| f64::from(l.frequency_hz)).fold(0.0, f64::max);
    if speed <= 0.0 || highest <= 0.0 || width < 20 || height < 3 {
        return Vec::new();
    }
    let strongest = lines.iter().map(|l| l.amplitude).fold(f32::MIN_POSITIVE, f32::max);
    let mut columns = vec![0.0_f64; width];
    for line in &lines {
        let at = (f64::from(line.frequency_hz) / (1.05 * highest) * width as f64) as usize;
        let db = 20.0 * f64::from(line.amplitude / strongest).max(1e-12).log10();
        let share = (1.0 + db / SPAN_DB).clamp(0.0, 1.0);
        columns[at.min(width - 1)] = columns[at.min(width - 1)].max(share * height as f64);
    }
    let row = |r: usize| -> String {
        let above = (height - 1 - r) as f64;
        let sign = |&c: &f64| match c - above {
            rest if rest >= 1.0 => "█",
            rest if rest > 0.0 => STEPS[((rest * 8.0) as usize).min(7)],
            _ => " ",
        };
        columns.iter().map(sign).collect()
    };
    let mut out: Vec<Line> = (0..height).map(|r| Line::styled(row(r), Style::new().cyan())).collect();
    let top = 1.05 * highest / speed;
    out.push(Line::styled(axis(top, width), Style::new().dark_gray()));
    out
}

/// Orders under the columns, at round numbers.
fn axis(top: f64, width: usize) -> String {
    /// Columns between two numbers, at least.
    const MIN_NUMBER_COLUMNS: f64 = 12.0;
    let least = MIN_NUMBER_COLUMNS * top / width as f64;
    let decade = 10f64.powf(least.log10().floor());
    let step =
        [1.0, 2.0, 5.0, 10.0].map(|n| n * decade).into_iter().find(|step| *step >= least).unwrap_or(10.0 * decade);
    let mut text = " ".repeat(width);
    let mut n = 0.0;
    while n * step < top {
        let at = (n * step / top * width as f64) as usize;
        let number = format!("{}", n * step);
        if at + number.len() <= width {
            text.replace_range(at..at + number.len(), &number);
        }
        n += 1.0;
    }
    text
}

fn all_lines(spectrum: &Spectrum) -> Vec<SpectralLine> {
    let of =
        |band: &meshband::message::MeshBand| [&[band.line][..], &band.sidebands[..], &band.gear_sidebands[..]].concat();
    spectrum.bands.iter().flat_map(of).filter(|line| line.amplitude > 0.0).collect()
}

fn event_lines(scene: &Scene, height: usize) -> Vec<Line<'static>> {
    let events = &scene.panel.events;
    let text = |(at, e): &(f64, meshband::events::Event)| {
        let times = if e.count > 1 { format!(", {} times", e.count) } else { String::new() };
        format!("{} ago: {}{times}", seconds(scene.now_s - at), event(e))
    };
    let faint = Style::new().dark_gray();
    match (events.back(), scene.events_open) {
        (None, _) => vec![Line::styled("no events", faint)],
        (Some(newest), false) => {
            vec![Line::styled(format!("{} events; newest {}; e shows all", events.len(), text(newest)), faint)]
        }
        (Some(_), true) => {
            let head = Line::styled(format!("{} events, newest first; e closes", events.len()), faint);
            let rest =
                events.iter().rev().take(height.saturating_sub(1)).map(|event| Line::raw(format!("  {}", text(event))));
            std::iter::once(head).chain(rest).collect()
        }
    }
}

fn footer(scene: &Scene) -> Line<'static> {
    let losses = scene.losses;
    let kept = match scene.capture.map(|capture| (capture.state(), capture.path())) {
        None => "no capture".to_owned(),
        Some((Ok(bytes), path)) => format!("{} KB in {}", bytes / 1000, path.display()),
        Some((Err(reason), _)) => format!("CAPTURE STOPPED: {reason}"),
    };
    let counters = [
        (losses.lost, "lost"),
        (losses.refused, "refused"),
        (losses.reopened, "reconnects"),
        (losses.restarts, "restarts"),
    ];
    let counted: String =
        counters.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!(", {count} {what}")).collect();
    let counted = if counted.is_empty() { ", none lost".to_owned() } else { counted };
    // The counters before the capture's name: what does not fit is cut at the end.
    let text = format!("q quit, h help  {} messages{counted}  {kept}", scene.panel.view.messages);
    Line::styled(text, Style::new().dark_gray())
}

const HELP: [&str; 14] = [
    "q, Ctrl-C   end; --json and --report are written then",
    "a           tell the node that all alarms are seen; latched ones end",
    "e           events as a list, or one line",
    "s           ask for a waveform (snapshot)",
    "t           run the self-test again",
    "h, ?, Esc   this help",
    "",
    "Bars: decibels below the strongest mesh harmonic, 60 dB over the width.",
    "Trends: the newest values over their own range. Faint: older than 10 s.",
    "SILENT: the link is open and nothing comes. LINK LOST: the port is gone;",
    "it is opened again after 0.5 s, 1 s, 2 s, ... 10 s.",
    "FM0, FM4, NA4 come once per average, the bandwidth once per timing:",
    "each value keeps its own age.",
    "The capture holds every byte: meshband monitor --replay FILE.",
];

fn draw_help(frame: &mut Frame, area: Rect) {
    let (width, height) = (76.min(area.width), (HELP.len() as u16 + 2).min(area.height));
    let place = Rect { x: (area.width - width) / 2, y: (area.height - height) / 2, width, height };
    let text: Vec<Line> = HELP.iter().map(|line| Line::raw(*line)).collect();
    frame.render_widget(ratatui::widgets::Clear, place);
    frame.render_widget(Paragraph::new(text).block(Block::bordered().title(" help ")), place);
}
