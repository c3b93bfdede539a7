'use strict';
// Finds clipped text, text over other text, columns outside and small print, and sends the findings to the window around this
// one. At a width of 750 px the rules for print apply, on A4, while the reader's theme is dark.
(async () => {
  await new Promise(done => setTimeout(done, 300));
  const print = innerWidth === 750;
  if (print) {
    dispatchEvent(new Event('beforeprint'));
    for (const rule of [...document.styleSheets].flatMap(sheet => [...sheet.cssRules])) {
      if (!(rule instanceof CSSMediaRule)) continue;
      if (rule.media.mediaText.includes('print')) rule.media.mediaText = 'all';
      else if (rule.media.mediaText.includes('screen')) rule.media.mediaText = 'not all';
    }
    document.documentElement.dataset.theme = 'dark';
    // A4 within margins of 12 mm.
    document.body.style.width = '703px';
    await new Promise(done => setTimeout(done, 300));
  }
  const findings = [];
  const width = print ? 703 : document.documentElement.clientWidth;
  const phone = width < 640;
  const name = element => element.tagName.toLowerCase() + (element.id ? '#' + element.id : '') + (element.className && element.className.baseVal === undefined ? '.' + element.className : '');
  const add = (what, element) => { if (findings.length < 40) findings.push(what + ': ' + name(element) + ' “' + element.textContent.trim().slice(0, 50) + '”'); };
  if (document.documentElement.scrollWidth > (print ? innerWidth : width)) findings.push('the page is ' + document.documentElement.scrollWidth + ' px wide in a window of ' + width);
  for (const box of document.querySelectorAll('.scroll, .list, .plots figure')) {
    if (!box.getClientRects().length || box.scrollWidth <= box.clientWidth + 1) continue;
    if (!phone) add('columns are outside', box);
    else if (!box.classList.contains('overflowing')) add('no hint to scroll', box);
  }
  for (const element of document.querySelectorAll('body *:not(script):not(style):not(option)')) {
    const text = [...element.childNodes].some(node => node.nodeType === 3 && node.data.trim());
    if (!text || !element.getClientRects().length || element.matches('.skip, [hidden]')) continue;
    const style = getComputedStyle(element);
    const hides = style.overflowX !== 'visible' && style.display !== 'inline';
    if (hides && element.tagName !== 'SELECT' && (element.scrollWidth > element.clientWidth + 1 && !element.closest('.scroll') || element.scrollHeight > element.clientHeight + 2)) add('clipped', element);
    const rect = element.getBoundingClientRect();
    if (element.matches('td, th') && element.scrollWidth > element.clientWidth + 1) add('over the next column', element);
    if (!element.closest('.scroll, .list, figure') && rect.right > width + 1) add('outside the page', element);
    const svg = element.ownerSVGElement;
    if (svg) {
      const bounds = svg.getBoundingClientRect();
      if (rect.left < bounds.left - 1 || rect.right > bounds.right + 1 || rect.top < bounds.top - 1 || rect.bottom > bounds.bottom + 1) add('outside its plot', element);
    }
    const levels = (svg ? style.fill : style.color).match(/[\d.]+/g) || [];
    if (print && !element.matches('[fill="#FFFFFF"]') && levels.length && levels.slice(0, 3).every(level => level > 140)) add('light on paper', element);
    const scale = svg ? svg.getBoundingClientRect().width / svg.viewBox.baseVal.width : 1;
    if (phone && parseFloat(style.fontSize) * scale < 10.95) add('text of ' + (parseFloat(style.fontSize) * scale).toFixed(1) + ' px', element);
  }
  const [left, right] = [...document.querySelectorAll('.slider .tag')].map(tag => tag.getBoundingClientRect());
  if (left && left.right > right.left) add('over the other', document.querySelector('.slider .tag'));
  parent.postMessage(JSON.stringify({ width, print, findings }), '*');
})();
