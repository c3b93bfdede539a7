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
    const area = make('textarea', { value: text });
    document.body.append(area);
    area.select();
    const copied = document.execCommand('copy');
    area.remove();
    return copied;
  };
  const flash = (button, text) => {
    const before = button.textContent;
    button.textContent = text;
    setTimeout(() => { button.textContent = before; }, 1200);
  };

  // The system's theme, unless the reader chooses another.
  const root = document.documentElement;
  const dark = () => (root.dataset.theme || (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light')) === 'dark';
  const theme = at('theme');
  const showTheme = () => {
    theme.textContent = dark() ? 'Light' : 'Dark';
    theme.setAttribute('aria-pressed', String(dark()));
  };
  theme.addEventListener('click', () => { root.dataset.theme = dark() ? 'light' : 'dark'; showTheme(); });
  showTheme();

  // Wide tables and plots say that they scroll; notes are printed.
  const hint = () => {
    for (const box of document.querySelectorAll('.scroll, .list, .plots figure')) box.classList.toggle('overflowing', box.scrollWidth > box.clientWidth + 1);
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

  // Protocols lead to their scenes.
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
  const fill = (select, texts) => select.replaceChildren(...texts.map((text, value) => make('option', { value, textContent: text })));
  const [runs, metric] = [at('run'), at('metric')];
  fill(runs, data.runs.map(run => run.label));
  fill(metric, metrics.map(each => each.name));
  const print = (each, value) => value === null || value === undefined ? '–' : value.toFixed(each.decimals);
  let selected = null;

  const list = () => {
    const run = data.runs[runs.value];
    const by = metrics[metric.value];
    const worse = each => {
      const value = each.scores[by.id];
      return value === undefined ? Infinity : by.higher ? value : -value;
    };
    const trials = run.trials.map((trial, place) => ({ trial, place })).sort((a, b) => worse(a.trial) - worse(b.trial) || a.place - b.place);
    const rows = trials.map(({ trial, place }) => {
      const button = make('button', { type: 'button', textContent: trial.scene + (trial.entry ? ' · ' + trial.entry : ''), title: trial.scene });
      const mark = trial.status === 'done' ? '' : trial.status;
      const row = make('tr', { tabIndex: -1 },
        make('td', { className: 'label' }, button),
        ...metrics.map(each => make('td', { textContent: print(each, trial.scores[each.id]) })),
        make('td', { textContent: mark || (trial.pictures.length ? '▣' : ''), title: mark ? trial.detail || '' : trial.pictures.length ? 'with pictures' : '' }));
      row.addEventListener('click', () => show(run, place, row));
      return row;
    });
    at('list').replaceChildren(...rows);
    at('detail').replaceChildren(make('p', { className: 'hint', textContent: 'Select a scene. The worst are listed first; ▣ marks scenes with pictures in this page.' }));
    selected = null;
    const first = trials.findIndex(({ trial }) => trial.pictures.length);
    if (first >= 0) rows[first].click();
  };

  const show = (run, place, row) => {
    if (selected) selected.removeAttribute('aria-selected');
    selected = row;
    row.setAttribute('aria-selected', 'true');
    const trial = run.trials[place];
    const facts = make('dl', {});
    const fact = (name, value) => { if (value !== null && value !== undefined && value !== '') facts.append(make('dt', { textContent: name }), make('dd', { textContent: value })); };
    for (const each of metrics) fact(each.name, print(each, trial.scores[each.id]));
    fact('Context frames', trial.context.join(', '));
    fact('Gaussians', trial.gaussians);
    fact('Encoding', trial.encode === null ? null : (trial.encode * 1e3).toFixed(1) + ' ms');
    fact('Status', trial.status === 'done' ? null : trial.status + (trial.detail ? ': ' + trial.detail : ''));
    const parts = [make('h3', { textContent: trial.scene }), make('p', { className: 'hint', textContent: run.label })];
    if (trial.pictures.length) {
      const frames = make('div', { className: 'frames' });
      const view = make('div', {});
      trial.pictures.forEach((picture, number) => {
        const scores = metrics.map(each => each.name + ' ' + print(each, picture.scores[each.id])).join(', ');
        const button = make('button', { type: 'button', textContent: 'frame ' + picture.frame + (picture.leaked ? ' (context)' : ''), title: scores });
        button.addEventListener('click', () => {
          for (const other of frames.children) other.setAttribute('aria-pressed', String(other === button));
          view.replaceChildren(...compare(picture, scores));
        });
        frames.append(button);
        if (number === 0) button.click();
      });
      parts.push(frames, view);
    } else {
      parts.push(make('p', { className: 'hint', textContent: 'This page contains no pictures of this scene.' }));
    }
    at('detail').replaceChildren(...parts, facts);
  };

  // Render over truth, divided by the slider; below, their difference.
  const compare = (picture, scores) => {
    const truth = make('img', { src: data.pictures[picture.truth], alt: 'truth' });
    const render = make('img', { src: data.pictures[picture.render], alt: 'render', className: 'over' });
    const range = make('input', { type: 'range', min: 0, max: 100, step: 0.5, value: 50 });
    range.setAttribute('aria-label', 'Render on the left, truth on the right');
    const slider = make('div', { className: 'slider' }, truth, render, make('div', { className: 'handle' }),
      make('span', { className: 'tag left', textContent: 'render' }), make('span', { className: 'tag right', textContent: 'truth' }), range);
    range.addEventListener('input', () => slider.style.setProperty('--cut', range.value + '%'));
    const canvas = make('canvas', {});
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', 'Error map');
    const gain = make('input', { type: 'range', min: 1, max: 20, value: 5 });
    const label = make('span', { textContent: '× 5' });
    const draw = () => { label.textContent = '× ' + gain.value; errorMap(canvas, truth, render, Number(gain.value)); };
    gain.addEventListener('input', draw);
    Promise.all([truth.decode(), render.decode()]).then(draw, () => { label.textContent = 'the pictures cannot be decoded'; });
    return [make('p', { className: 'hint', textContent: scores }), slider,
      make('div', { className: 'maps' }, canvas, make('div', {},
        make('label', {}, 'Error map, mean absolute difference of the 8-bit pictures ', gain, ' ', label)))];
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

  runs.addEventListener('change', list);
  metric.addEventListener('change', list);
  list();
})();
