//! The picture: state and quality, speed and rates, alarms, mesh bands, values, events, keys; from 80x24 upwards.
//!
//! What does not fit is left out from below, never wrapped: events first, then the order view, then sidebands. Bars are decibels over
//! `SPAN_DB` below the strongest line, because a tenth of the strongest line is not yet nothing.

use super::capture::Capture;
use super::link::Standing;
use super::panel::{Alarm, Panel, Trend, VALUES};
use crate::link::words::{watched, words};
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
    /// Times the link was opened again.
    pub reconnects: u32,
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
    let panel = scene.panel;
    let wide = area.width >= 120;
    let alarms = panel.alarms.len().clamp(1, 4) as u16;
    let values_rows = if wide { VALUES.len() as u16 } else { VALUES.len().div_ceil(2) as u16 };
    let bands = panel.view.spectrum.as_ref().map_or(1, |s| s.bands.len()).max(1) as u16;
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
            Paragraph::new(band_lines(scene, bands_area.width)).block(titled("mesh bands", scene)),
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
    let bands = scene.panel.view.spectrum.as_ref().map_or(1, |s| s.bands.len()).max(1) as u16;
    let [top, bottom] =
        Layout::vertical([Constraint::Length((bands + 2).min(left.height)), Constraint::Min(0)]).areas(left);
    frame.render_widget(Paragraph::new(band_lines(scene, top.width)).block(titled("mesh bands", scene)), top);
    frame.render_widget(
        Paragraph::new(order_lines(scene, bottom)).block(titled("orders of the pinion, dB below the strongest", scene)),
        bottom,
    );
    frame.render_widget(Paragraph::new(value_lines(scene, 1, right.width)).block(titled("values", scene)), right);
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

/// "0.3 s", "12 s", "3 min".
fn seconds(age_s: f64) -> String {
    match age_s {
        age if age < 10.0 => format!("{:.1} s", age.max(0.0)),
        age if age < 120.0 => format!("{age:.0} s"),
        age => format!("{:.0} min", age / 60.0),
    }
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
    let who = panel.identity.as_ref().map_or(String::new(), |node| format!("   {}", node.board));
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

fn alarm_lines(scene: &Scene) -> Vec<Line<'static>> {
    let panel = scene.panel;
    if panel.alarms.is_empty() {
        let text = if panel.bands.is_empty() { "no alarm (none is configured)" } else { "no alarm" };
        return vec![Line::styled(text, Style::new().dark_gray())];
    }
    let line = |(&index, alarm): (&u32, &Alarm)| {
        let what = panel.bands.get(index as usize).map_or_else(
            || format!("alarm {index}"),
            |band| format!("alarm {index}: {} above {}", watched(band.watched), band.raise),
        );
        let since = seconds(scene.now_s - alarm.raised_s);
        let (text, style) = match (alarm.cleared_s, alarm.acknowledged) {
            (Some(at), _) => (format!("{what}, over since {}", seconds(scene.now_s - at)), Style::new().yellow()),
            (None, true) => (format!("{what}, for {since}, seen"), Style::new().red()),
            (None, false) => (format!("{what}, for {since}; a acknowledges"), Style::new().white().on_red().bold()),
        };
        Line::styled(format!(" {text} "), style)
    };
    panel.alarms.iter().map(line).collect()
}

fn band_lines(scene: &Scene, width: u16) -> Vec<Line<'static>> {
    let Some(spectrum) = &scene.panel.view.spectrum else {
        return vec![Line::styled("no mesh-band spectrum yet: it needs a locked speed", Style::new().dark_gray())];
    };
    let strongest = spectrum.bands.iter().map(|b| b.line.amplitude).fold(f32::MIN_POSITIVE, f32::max);
    let trend_width = if width >= 100 { 30 } else { 12 };
    let bar_width = usize::from(width).saturating_sub(36 + trend_width + 22).clamp(8, 60);
    let line = |band: &meshband::message::MeshBand| {
        let trend = scene.panel.harmonics.get(&band.harmonic).map_or(String::new(), |t| sparkline(t, trend_width));
        let side = [&band.sidebands[..], &band.gear_sidebands[..]].concat();
        let side = side.iter().max_by(|a, b| a.amplitude.total_cmp(&b.amplitude)).filter(|l| l.amplitude > 0.0);
        let side = side.map_or(String::new(), |l| format!(" side {:8.1} {:8.4}", l.frequency_hz, l.amplitude));
        Line::from(vec![
            Span::raw(format!("{}x {:9.2} Hz {:9.4} ", band.harmonic, band.line.frequency_hz, band.line.amplitude)),
            Span::styled(bar(band.line.amplitude, strongest, bar_width), Style::new().cyan()),
            Span::styled(format!(" {trend:trend_width$}"), Style::new().green()),
            Span::styled(side, Style::new().dark_gray()),
        ])
    };
    spectrum.bands.iter().map(line).collect()
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
    let end = format!("{top:.1}");
    out.push(Line::styled(format!("0{end:>w$}", w = width - 1), Style::new().dark_gray()));
    out
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
        format!("{} ago: {} {}{times}", seconds(scene.now_s - at), words(&e.kind), e.detail)
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
    // The capture before the counters: what does not fit is cut at the end.
    let text = format!(
        "q quit, h help  {kept}  {} messages, {} lost, {} refused, {} reconnects, {} restarts",
        scene.panel.view.messages, losses.lost, losses.refused, scene.reconnects, losses.restarts
    );
    Line::styled(text, Style::new().dark_gray())
}

const HELP: [&str; 14] = [
    "q, Ctrl-C   end; --json and --report are written then",
    "a           acknowledge all alarms; those that are over go",
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
