use diffray::{geometry::Geometry, plan::Plan, scene::*, simulate};
fn main() {
    let p = std::env::args().nth(1).unwrap();
    let ov: Vec<Override> = std::env::args().skip(2).map(|s| Override::parse(&s).unwrap()).collect();
    let l = match Scene::load(std::path::Path::new(&p), &ov) {
        Ok(l) => l,
        Err(e) => {
            println!("{e}");
            return;
        }
    };
    let t = std::time::Instant::now();
    let g = Geometry::new(&l.scene).unwrap();
    let plan = Plan::new(&l.scene, &g);
    println!("{}", plan.text());
    let o = simulate::run(&l.scene, &g, &plan, &|_| ()).unwrap();
    for w in &o.warnings {
        println!("{w}");
    }
    for r in &o.receptions {
        println!("{} -> {} ({} paths)", r.source, r.probe, r.paths.len());
        for p in r.paths.iter().take(6) {
            println!(
                "    {:.3} ms {:?} {}",
                p.delay_s * 1e3,
                p.intensity.iter().map(|i| (100.0 * 10.0 * i.log10()).round() / 100.0).collect::<Vec<_>>(),
                p.label
            );
        }
        println!(
            "  {:?}",
            r.levels
                .iter()
                .map(|l| format!("{}: {:.2}+-{:.2} ({:.2})", l.band_hz, l.level_db(), l.std_error_db(), l.early_share))
                .collect::<Vec<_>>()
        );
    }
    println!("rays {} stop {} times {:?} total {:.2}", o.rays, o.stop, o.times_s, t.elapsed().as_secs_f64());
}
