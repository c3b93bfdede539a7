'use strict';
// Clicks through the page as a reader would, and writes the results into it.
(async () => {
  const results = {};
  const check = (name, passed) => { results[name] = Boolean(passed); };
  const at = id => document.getElementById(id);
  const wait = ms => new Promise(done => setTimeout(done, ms));
  const all = query => [...document.querySelectorAll(query)];
  try {
    check('tables', all('#tables table').length > 0);
    check('plots', all('#plots svg').length > 0);
    check('anchors', all('nav a').every(link => document.querySelector(link.getAttribute('href'))));
    const before = getComputedStyle(document.body).backgroundColor;
    at('theme').click();
    check('theme', getComputedStyle(document.body).backgroundColor !== before && at('theme').textContent !== '');
    at('theme').click();
    const number = document.querySelector('[data-cite]');
    number.click();
    check('cite', at('cite').open && at('cite-text').textContent.includes('protocol'));
    at('cite').close();
    const notes = document.querySelector('details.notes');
    notes.querySelector('summary').click();
    await wait(20);
    check('notes', notes.open);
    const scores = () => all('#list tr').map(row => Number(row.children[1].textContent)).filter(Number.isFinite);
    check('worst-first', scores().length > 1 && scores().every((value, place, list) => place === 0 || list[place - 1] <= value));
    check('scene-selected', all('#list tr[aria-selected="true"]').length === 1);
    const other = all('#list tr').find(row => row.getAttribute('aria-selected') !== 'true');
    other.click();
    check('another-scene', other.getAttribute('aria-selected') === 'true' && at('detail').textContent.includes(other.querySelector('button').title));
    const pictured = all('#list tr').find(row => row.lastElementChild.textContent === '▣');
    pictured.click();
    for (let tries = 0; tries < 100 && !all('.slider img').every(image => image.naturalWidth > 0); tries += 1) await wait(50);
    await wait(200);
    const range = document.querySelector('.slider input');
    range.value = 20;
    range.dispatchEvent(new Event('input'));
    check('slider', document.querySelector('.slider').style.getPropertyValue('--cut') === '20%');
    check('pictures', all('.slider img').length === 2 && all('.slider img').every(image => image.naturalWidth > 0));
    const canvas = document.querySelector('.maps canvas');
    const bright = () => {
      const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
      let sum = 0;
      for (let i = 0; i < data.length; i += 4) sum += data[i];
      return sum;
    };
    // Pictures are decoded asynchronously.
    for (let tries = 0; tries < 100 && bright() === 0; tries += 1) await wait(50);
    const dim = bright();
    const gain = document.querySelector('.maps input');
    gain.value = 20;
    gain.dispatchEvent(new Event('input'));
    check('error-map', dim > 0 && bright() > dim);
    const frames = all('.frames button');
    frames[frames.length - 1].click();
    check('frames', frames[frames.length - 1].getAttribute('aria-pressed') === 'true');
    const runs = at('run');
    runs.value = runs.options.length - 1;
    runs.dispatchEvent(new Event('change'));
    check('another-method', at('list').children.length > 0);
    check('no-script-from-data', window.injected === undefined && all('script').length === 3);
    check('no-network', performance.getEntriesByType('resource').every(entry => entry.name.startsWith('data:')));
    check('fits-width', document.documentElement.scrollWidth <= document.documentElement.clientWidth);
  } catch (error) {
    results['error: ' + error.message] = false;
  }
  const report = document.createElement('pre');
  report.id = 'selftest';
  report.hidden = true;
  report.textContent = JSON.stringify(results);
  document.body.append(report);
})();
