/// The probability, were both sides equally likely to win, of a score at least as uneven as this one: the exact two-sided
/// binomial test, ties left out. 1 without wins and losses.
pub fn sign_test(wins: u64, losses: u64) -> f64 {
    let (fewer, games) = (wins.min(losses), wins + losses);
    if games == 0 {
        return 1.0;
    }
    // ln of (games choose fewer) / 2^games; the outcomes below follow from it by their ratios.
    let choices: f64 = (1..=fewer).map(|k| ((games - fewer + k) as f64 / k as f64).ln()).sum();
    let likeliest = choices - games as f64 * std::f64::consts::LN_2;
    let (mut ratio, mut sum) = (1.0, 1.0);
    for k in (1..=fewer).rev() {
        ratio *= k as f64 / (games - k + 1) as f64;
        sum += ratio;
        if ratio < f64::EPSILON * sum {
            break;
        }
    }
    let both = 2.0 * likeliest.exp() * sum;
    if both < 1.0 { both } else { 1.0 }
}
