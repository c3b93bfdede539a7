'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const at = id => document.getElementById(id);
  const make = (tag, properties, ...children) => {
    const element = Object.assign(document.createElement(tag), properties);
    element.append(...children);
    return element;
  };
  const copy = text => {
    const focused = document.activeElement;
    const area = make('textarea', { value: text });
    // Nothing outside an open dialog can be selected.
    (document.querySelector('dialog[open]') || document.body).append(area);
    area.select();
    const copied = document.execCommand('copy');
    area.remove();
    focused.focus({ preventScroll: true });
    return copied;
  };
  const flash = (button, text) => {
    button.dataset.label ??= button.textContent;
    button.textContent = text;
    setTimeout(() => { button.textContent = button.dataset.label; }, 1200);
  };

  // The system's theme, unless the reader chooses another.
  const root = document.documentElement;
  const dark = () => (root.dataset.theme || (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light')) === 'dark';
  const theme = at('theme');
  const showTheme = () => { theme.textContent = dark() ? 'Light' : 'Dark'; };
  theme.addEventListener('click', () => { root.dataset.theme = dark() ? 'light' : 'dark'; showTheme(); });
  showTheme();

  // Wide tables and plots say that they scroll; notes are printed. A plot takes the keyboard's focus only while it scrolls; boxes of
  // tables always do.
  const hint = () => {
    for (const box of document.querySelectorAll('.scroll, .list, .plots figure')) {
      const overflows = box.scrollWidth > box.clientWidth + 1;
      box.classList.toggle('overflowing', overflows);
      if (!box.matches('.plots figure')) continue;
      const label = box.querySelector('svg').getAttribute('aria-label');
      for (const [name, value] of [['tabindex', '0'], ['role', 'group'], ['aria-label', 'Scrolls sideways: ' + label]]) {
        if (overflows) box.setAttribute(name, value);
        else box.removeAttribute(name);
      }
    }
  };
  hint();
  addEventListener('resize', hint);
  addEventListener('beforeprint', () => { for (const notes of document.querySelectorAll('details')) notes.open = true; });

  // Tables: copy as text, cite a number.
  for (const button of document.querySelectorAll('[data-copy]')) {
    button.addEventListener('click', () => {
      const text = data.texts[button.dataset.table][button.dataset.copy];
      flash(button, copy(text) ? 'Copied' : 'Not copied');
    });
  }
  for (const button of document.querySelectorAll('[data-cite]')) {
    button.addEventListener('click', () => {
      at('cite-text').textContent = button.dataset.cite;
      at('cite').showModal();
    });
  }
  at('cite-copy').addEventListener('click', event => flash(event.target, copy(at('cite-text').textContent) ? 'Copied' : 'Not copied'));

  // Links of protocols go to their scenes.
  for (const link of document.querySelectorAll('[data-protocol]')) {
    link.addEventListener('click', () => {
      const first = data.runs.findIndex(run => run.protocol === link.dataset.protocol);
      if (first < 0) return;
      at('run').value = first;
      at('run').dispatchEvent(new Event('change'));
    });
  }

  // Scenes.
  if (!at('list')) return;
  const metrics = data.metrics;
  const fill = (select, options) => select.replaceChildren(...options.map(([value, textContent]) => make('option', { value, textContent })));
  const [runs, compared, metric, order] = ['run', 'compared', 'metric', 'order'].map(at);
  fill(runs, data.runs.map((run, place) => [place, run.label]));
  fill(metric, metrics.map((each, place) => [place, each.name]));
  // What is printed as 0 has no sign.
  const print = (each, value) => value === null || value === undefined ? '–' : value.toFixed(each.decimals).replace(/^-(?=0\.?0*$)/, '');
  const signed = (each, value) => { const text = print(each, value); return Number(text) > 0 ? '+' + text : text; };
  let selected = null;

  // Methods of the same protocol.
  const others = () => {
    const before = compared.selectedOptions[0] && compared.selectedOptions[0].textContent;
    const shown = data.runs[runs.value];
    const same = data.runs.map((run, place) => [place, run]).filter(([, run]) => run !== shown && run.protocol === shown.protocol && run.protocol_hash === shown.protocol_hash);
    fill(compared, [[-1, 'the truth alone'], ...same.map(([place, run]) => [place, run.title])]);
    const again = [...compared.options].find(option => option.textContent === before);
    if (again) compared.value = again.value;
  };
  const placeOf = trial => trial.entry + ' ' + trial.scene;
  for (const run of data.runs) run.places = new Map(run.trials.map(trial => [placeOf(trial), trial]));
  const partner = trial => {
    const run = data.runs[compared.value];
    const other = run && run.places.get(placeOf(trial));
    return other && other.data === trial.data ? other : undefined;
  };
  const numbers = value => value !== undefined && value !== null;
  // How much better a trial is than under the other method, over the targets that both have; negative if it is worse, by whichever metric.
  const differenceOf = (trial, by) => {
    const [scores, others] = [trial, partner(trial)].map(each => (each && each.by_frame[by.id]) || []);
    const other = new Map(others);
    const differences = scores.filter(([frame]) => other.has(frame)).map(([frame, score]) => score - other.get(frame));
    if (!differences.length) return undefined;
    return (by.higher ? 1 : -1) * differences.reduce((sum, difference) => sum + difference, 0) / differences.length;
  };

  // Without any score, there is no metric to sort by.
  const unscored = { id: '', name: '', higher: true, decimals: 0 };
  const list = () => {
    const isCompared = Number(compared.value) >= 0;
    order.querySelector('[value="difference"]').disabled = !isCompared;
    if (!isCompared && order.value === 'difference') order.value = 'worst';
    const run = data.runs[runs.value];
    const by = metrics[metric.value] || unscored;
    const sign = by.higher ? 1 : -1;
    const goodness = trial => numbers(trial.scores[by.id]) ? sign * trial.scores[by.id] : Infinity;
    const listed = run.trials.map((trial, place) => ({ trial, place, difference: differenceOf(trial, by) }));
    const ascending = listed.sort((a, b) => goodness(a.trial) - goodness(b.trial) || a.place - b.place);
    const scored = ascending.filter(({ trial }) => numbers(trial.scores[by.id]));
    const middle = scored.length ? goodness(scored[Math.floor(scored.length / 2)].trial) : 0;
    const keys = {
      // A trial that failed is the worst; one without a score for another reason, as of renders identical to the truth, is not.
      worst: ({ trial }) => trial.status === 'failed' && !numbers(trial.scores[by.id]) ? -Infinity : goodness(trial),
      best: ({ trial }) => numbers(trial.scores[by.id]) ? -goodness(trial) : Infinity,
      typical: ({ trial }) => numbers(trial.scores[by.id]) ? Math.abs(goodness(trial) - middle) : Infinity,
      difference: ({ difference }) => difference ?? Infinity,
    };
    const key = keys[order.value];
    const trials = [...ascending].sort((a, b) => key(a) - key(b));
    at('difference').hidden = !isCompared;
    const rows = trials.map(({ trial, place, difference }) => {
      const button = make('button', { type: 'button', textContent: trial.scene + (trial.entry ? ' · ' + trial.entry : ''), title: trial.scene });
      const mark = trial.status === 'done' ? '' : trial.status;
      const row = make('tr', { tabIndex: -1 },
        make('td', { className: 'label' }, button),
        ...metrics.map(each => make('td', { textContent: print(each, trial.scores[each.id]) })),
        make('td', { textContent: signed(by, difference), hidden: !isCompared }),
        make('td', { textContent: mark || (trial.images.length ? '▣' : ''), title: mark ? trial.detail || '' : trial.images.length ? 'with images' : '' }));
      row.addEventListener('click', () => show(run, place, row));
      return row;
    });
    at('list').replaceChildren(...rows);
    at('detail').replaceChildren(make('p', { className: 'hint', textContent: 'Select a scene; ▣ marks scenes with images in this page.' }));
    selected = null;
    const rowOf = place => rows[trials.findIndex(each => each.place === place)];
    extremes(scored, by, rowOf);
    const first = trials.findIndex(({ trial }) => trial.images.length);
    if (first >= 0) rows[first].click();
    hint();
  };

  // The worst and the best trial, if they have images, and of the others with images the one nearest the median.
  const extremes = (scored, by, rowOf) => {
    const withImages = scored.filter(({ trial }) => trial.images.length);
    const middle = Math.floor(scored.length / 2);
    const nearest = [...withImages].sort((a, b) => Math.abs(scored.indexOf(a) - middle) - Math.abs(scored.indexOf(b) - middle))[0];
    const [worst, best] = [scored[0], scored[scored.length - 1]].map(one => withImages.includes(one) ? one : null);
    const typical = nearest === worst || nearest === best ? null : nearest;
    const chosen = [['worst', worst], ['typical', typical], ['best', best === worst ? null : best]].filter(([, one]) => one);
    at('extremes').replaceChildren(...chosen.map(([name, { trial, place }]) => {
      const image = trial.images[0];
      const images = ['truth', 'render'].map(kind => make('img', { src: data.images[image[kind]], alt: kind }));
      const rank = scored.findIndex(one => one.place === place) + 1;
      const button = make('button', { type: 'button', textContent: name });
      button.addEventListener('click', () => rowOf(place).click());
      return make('figure', {}, make('div', { className: 'pair' }, ...images),
        make('figcaption', {}, button, ' ' + by.name + ' ' + print(by, trial.scores[by.id]) + ', rank ' + rank + ' of ' + scored.length + '; truth, render'));
    }));
  };

  const show = (run, place, row) => {
    if (selected) selected.removeAttribute('aria-selected');
    selected = row;
    row.setAttribute('aria-selected', 'true');
    const trial = run.trials[place];
    const other = partner(trial);
    const facts = make('dl', {});
    const fact = (name, value) => { if (value !== null && value !== undefined && value !== '') facts.append(make('dt', { textContent: name }), make('dd', { textContent: value })); };
    const ofOther = each => other ? ' (' + print(each, other.scores[each.id]) + ' by ' + data.runs[compared.value].title + ')' : '';
    for (const each of metrics) fact(each.name, print(each, trial.scores[each.id]) + ofOther(each));
    fact('Context frames', trial.context.join(', '));
    fact('Gaussians', trial.gaussians);
    fact('Encoding', trial.encode === null ? null : (trial.encode * 1e3).toFixed(1) + ' ms');
    fact('Status', trial.status === 'done' ? null : trial.status + (trial.detail ? ': ' + trial.detail : ''));
    const parts = [make('h3', { textContent: trial.scene }), make('p', { className: 'hint', textContent: run.label })];
    if (trial.images.length) {
      const frames = make('div', { className: 'frames' });
      const view = make('div', {});
      trial.images.forEach((image, number) => {
        const scores = metrics.map(each => each.name + ' ' + print(each, image.scores[each.id])).join(', ');
        const button = make('button', { type: 'button', textContent: 'frame ' + image.frame + (image.leaked ? ' (context)' : ''), title: scores });
        const second = other && other.images.find(each => each.frame === image.frame);
        button.addEventListener('click', () => {
          for (const each of frames.children) each.setAttribute('aria-pressed', String(each === button));
          view.replaceChildren(...compare(run, trial, image, second, scores));
        });
        frames.append(button);
        if (number === 0) button.click();
      });
      parts.push(frames, view);
    } else {
      parts.push(make('p', { className: 'hint', textContent: 'This page contains no images of this scene.' }));
    }
    at('detail').replaceChildren(...parts, facts);
  };

  // Two images divided by a slider; below, everything in a row: context, truth, renders and their errors.
  const compare = (run, trial, image, second, scores) => {
    const img = (place, alt) => make('img', { src: data.images[place], alt });
    const title = data.runs[compared.value] ? data.runs[compared.value].title : '';
    const [left, right] = [img(image.render, run.title), second ? img(second.render, title) : img(image.truth, 'truth')];
    left.className = 'over';
    const range = make('input', { type: 'range', min: 0, max: 100, step: 0.5, value: 50 });
    range.setAttribute('aria-label', left.alt + ' on the left, ' + right.alt + ' on the right');
    const slider = make('div', { className: 'slider' }, right, left, make('div', { className: 'handle' }),
      make('span', { className: 'tag left', textContent: second ? run.title : 'render' }), make('span', { className: 'tag right', textContent: right.alt }), range);
    range.addEventListener('input', () => slider.style.setProperty('--cut', range.value + '%'));
    const gain = make('input', { type: 'range', min: 1, max: 20, value: 5 });
    const label = make('span', {});
    const figure = (element, name, note) => make('figure', {}, element, make('figcaption', {}, make('b', { textContent: name }), ' ' + note));
    const maps = [];
    const errorOf = (place, name) => {
      const canvas = make('canvas', {});
      canvas.setAttribute('role', 'img');
      canvas.setAttribute('aria-label', 'Error map of ' + name);
      maps.push([canvas, img(image.truth, 'truth'), img(place, 'render')]);
      return figure(canvas, 'error', 'of ' + name);
    };
    const row = trial.seen.map(([frame, place]) => figure(img(place, 'context'), 'context', 'frame ' + frame));
    row.push(figure(img(image.truth, 'truth'), 'target', 'frame ' + image.frame));
    row.push(figure(img(image.render, 'render'), 'render', run.title), errorOf(image.render, run.title));
    if (second) row.push(figure(img(second.render, 'render'), 'render', title), errorOf(second.render, title));
    const draw = () => {
      label.textContent = '× ' + gain.value;
      for (const [canvas, truth, render] of maps) {
        const [expected, found] = [truth, render].map(each => each.naturalWidth + '×' + each.naturalHeight);
        if (found === expected) errorMap(canvas, truth, render, Number(gain.value));
        else canvas.replaceWith(make('p', { textContent: 'The sizes differ: ' + found + ', not ' + expected + '.' }));
      }
    };
    gain.addEventListener('input', draw);
    Promise.all(maps.flatMap(([, truth, render]) => [truth.decode(), render.decode()])).then(draw, () => { label.textContent = 'the images cannot be decoded'; });
    return [make('p', { className: 'hint', textContent: scores }), slider,
      make('div', { className: 'maps' }, make('div', { className: 'strip' }, ...row),
        make('label', {}, 'Errors: mean absolute difference of the 8-bit images ', gain, ' ', label))];
  };

  // Black, purple, orange, white: brighter is worse, even without colours.
  const ramp = [[0, 0, 4], [87, 16, 110], [188, 55, 84], [249, 142, 9], [252, 255, 164]];
  const errorMap = (canvas, truth, render, gain) => {
    const [width, height] = [truth.naturalWidth, truth.naturalHeight];
    const samples = image => {
      Object.assign(canvas, { width, height });
      const context = canvas.getContext('2d', { willReadFrequently: true });
      context.drawImage(image, 0, 0, width, height);
      return context.getImageData(0, 0, width, height);
    };
    const [a, b] = [samples(truth), samples(render)];
    for (let i = 0; i < a.data.length; i += 4) {
      const difference = Math.abs(a.data[i] - b.data[i]) + Math.abs(a.data[i + 1] - b.data[i + 1]) + Math.abs(a.data[i + 2] - b.data[i + 2]);
      const share = Math.min(1, difference / 765 * gain) * (ramp.length - 1);
      const low = Math.min(ramp.length - 2, Math.floor(share));
      for (let c = 0; c < 3; c += 1) a.data[i + c] = ramp[low][c] + (share - low) * (ramp[low + 1][c] - ramp[low][c]);
      a.data[i + 3] = 255;
    }
    canvas.getContext('2d').putImageData(a, 0, 0);
  };

  runs.addEventListener('change', () => { others(); list(); });
  for (const select of [compared, metric, order]) select.addEventListener('change', list);
  others();
  list();
})();
