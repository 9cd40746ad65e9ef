//! The page of `report` in a browser: every figure has a size, links have a target, and texts can be read on wide and
//! narrow screens, light and dark.

use std::{fs, path::PathBuf};

use crate::{report::models, runner::*};

/// Path of a browser.
fn chromium() -> Option<PathBuf> {
    let paths = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome"];
    std::env::split_paths(&paths).flat_map(|path| names.map(|name| path.join(name))).find(|path| path.is_file())
}

/// Opens a page in a frame of a width, folds and all. Returns the browser's measurements: the fit of the content, the
/// number of figures with a size, links without a target, and the least contrast of the texts with the paper.
fn opened(browser: &Path, folder: &Path, name: &str, width: u32, dark: bool) -> String {
    let frame = format!(
        "<!DOCTYPE html><meta name=\"color-scheme\" content=\"light dark\"><title>waiting</title><iframe id=\"page\" src=\"{name}\" width=\"{width}\" height=\"900\"></iframe><script>\
         onload = () => {{ const page = document.getElementById('page').contentDocument; \
         page.querySelectorAll('details').forEach(one => one.open = true); \
         const figures = [...page.querySelectorAll('svg')].filter(svg => svg.checkVisibility()); \
         const sized = figures.filter(svg => {{ const box = svg.getBoundingClientRect(); return box.width > 200 && box.height > 20 && box.right <= {width}; }}); \
         const broken = [...page.querySelectorAll('a')].filter(a => !page.getElementById(a.getAttribute('href').slice(1))); \
         const light = colour => {{ const [r, g, b] = colour.match(/[\\d.]+/g).map(v => v / 255).map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4); \
         return 0.2126 * r + 0.7152 * g + 0.0722 * b; }}; \
         const paper = light(page.defaultView.getComputedStyle(page.documentElement).backgroundColor); \
         const ratio = colour => {{ const own = light(colour); return (Math.max(own, paper) + 0.05) / (Math.min(own, paper) + 0.05); }}; \
         const texts = [...page.querySelectorAll('p, td, th, figcaption, summary')].map(e => page.defaultView.getComputedStyle(e).color); \
         const drawn = [...page.querySelectorAll('svg text')].map(e => page.defaultView.getComputedStyle(e).fill); \
         const least = Math.min(...[...new Set([...texts, ...drawn])].map(ratio)); \
         document.title = `${{page.documentElement.scrollWidth <= page.documentElement.clientWidth ? 'fits' : 'overflows'}} figures ${{sized.length}} of ${{figures.length}} sections ${{page.querySelectorAll('h2').length}} \
         broken ${{broken.length}} paper ${{paper.toFixed(3)}} contrast ${{least.toFixed(2)}}`; }}\
         </script>"
    );
    fs::write(folder.join("frame.html"), frame).expect("a file");
    let profile = tempfile::tempdir().expect("a folder");
    let output = Command::new(browser)
        .args([
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--allow-file-access-from-files",
            "--virtual-time-budget=5000",
            "--enable-logging=stderr",
        ])
        .args(dark.then_some("--blink-settings=preferredColorScheme=0"))
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg("--dump-dom")
        .arg(format!("file://{}", folder.join("frame.html").display()))
        .output()
        .expect("the browser runs");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!errors.contains("CONSOLE"), "{errors}");
    let title = text.split("<title>").nth(1).and_then(|rest| rest.split("</title>").next());
    title.unwrap_or_else(|| panic!("{text}{}", String::from_utf8_lossy(&output.stderr))).to_owned()
}

#[test]
fn browsers_draw_every_figure() {
    let Some(browser) = chromium() else {
        eprintln!("no Chromium is installed: pages were not opened");
        return;
    };
    let folder = models(1200);
    fleetfoot(folder.path(), &["report", "model.json", "held-out.csv", "--horizon", "40"]).ok();
    for (width, dark) in [(375, false), (375, true), (1440, false), (1440, true)] {
        let summary = opened(&browser, folder.path(), "report.html", width, dark);
        assert!(summary.starts_with("fits figures"), "{width}: {summary}");
        let words: Vec<&str> = summary.split_whitespace().collect();
        assert!(words[2] == words[4] && words[2].parse::<usize>().is_ok_and(|figures| figures >= 12), "{summary}");
        let number = |place: usize| words[place].parse::<f64>().expect("a number");
        assert_eq!((words[6], number(8)), ("6", 0.0), "{summary}");
        // Light paper or dark, and texts that WCAG 2.1 (1.4.3) calls readable.
        assert!(if dark { number(10) < 0.05 } else { number(10) > 0.9 }, "{summary}");
        assert!(number(12) >= 4.5, "{summary}");
    }
}
