//! Reports: every picture draws, texts are escaped, tables align, nothing comes from outside the file.

use meshband_host::report::Report;
use meshband_host::report::plot::{Axes, Series, fit_with_residual, heat_map, lines, stems};
use meshband_host::terminal::table;
use std::path::Path;

const AXES: Axes = Axes { x: "speed, Hz", y: "bandwidth, kHz" };

#[test]
fn regress_every_picture_draws_and_the_file_stands_alone() {
    let curve = |scale: f64| (0..=100).map(|i| 0.01 * f64::from(i)).map(|x| (x, scale * x * x)).collect::<Vec<_>>();
    let points: Vec<(f64, f64)> =
        curve(3.0).into_iter().step_by(10).map(|(x, y)| (x, y + 0.05 * (40.0 * x).sin())).collect();
    let residuals: Vec<(f64, f64)> = points.iter().map(|&(x, y)| (x, y - 3.0 * x * x)).collect();
    let measured = Series::new("measured", points);
    let fit = fit_with_residual(&measured, &Series::new("fit", curve(3.0)), &residuals, AXES, "residual").unwrap();
    let two = lines(&[Series::new("a <b>", curve(1.0)), Series::new("c", curve(2.0))], AXES).unwrap();
    let nothing = stems(&[Series::new("empty", vec![(f64::NAN, 1.0)])], AXES).unwrap();
    let values: Vec<Vec<f64>> =
        (0..24).map(|r| (0..60).map(|c| (0.2 * f64::from(c)).sin() * (0.3 * f64::from(r)).cos()).collect()).collect();
    let map = heat_map(&values, 0.0..25.0, 0.0..10.0, AXES).unwrap();
    assert!(heat_map(&[vec![1.0], vec![]], 0.0..1.0, 0.0..1.0, AXES).is_err());
    let report = Report::new("A & B", "x < y")
        .figure("k", "1 \"quoted\"")
        .section("Pictures")
        .picture(&fit, "fit")
        .picture(&two, "two")
        .picture(&nothing, "nothing")
        .picture(&map, "map")
        .table("numbers", &["name", "value"], &[vec!["a".into(), "1.5".into()]]);
    let html = report.html();
    assert!(html.contains("A &amp; B") && html.contains("x &lt; y") && !html.contains("a <b>"));
    assert!(html.contains("<td class=\"n\">1.5</td>"));
    assert!(!html.contains("http://") || html.matches("http://").count() == html.matches("http://www.w3.org").count());
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("pictures.html"), html).unwrap();
}

#[test]
fn regress_terminal_table_aligns_numbers_right() {
    let text = table(&["name", "Hz"], &[vec!["a".into(), "12.5".into()], vec!["long name".into(), "3.0".into()]]);
    assert_eq!(text, "name         Hz\na          12.5\nlong name   3.0\n");
}
