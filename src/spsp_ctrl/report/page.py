"""The HTML page around a report: style sheet, read-out script, and small building blocks. No external resources."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

# Blue and vermilion (Okabe and Ito) stay apart under every common colour deficiency; pitch and roll keep them.
CSS = """
:root{color-scheme:light dark;--bg:#f3f5f8;--card:#fff;--ink:#14202d;--muted:#586676;--line:#dfe4ea;--grid:#e9edf1;
--pitch:#0072b2;--roll:#c94f00;--base:#8593a3;--third:#007a5e;--good:#0b7a55;--bad:#b3261e;--warn:#8f5b00;
--goodbg:#e5f4ed;--badbg:#fcebe9;--warnbg:#fdf3e0;--settle:#14202d0d;--bandg:#0b7a5512;--bandw:#e6a0001c}
@media (prefers-color-scheme:dark){:root{--bg:#0d1218;--card:#151c25;--ink:#e7edf3;--muted:#9caab9;--line:#2a3541;
--grid:#222c37;--pitch:#56b4e9;--roll:#f28e4b;--base:#7d8c9c;--third:#3fc79a;--good:#45cf9d;--bad:#ff8a80;--warn:#f0bd5e;
--goodbg:#12302a;--badbg:#3a1d1c;--warnbg:#352a14;--settle:#ffffff0d;--bandg:#45cf9d14;--bandw:#f0bd5e1c}}
*{box-sizing:border-box}
body{margin:0;background:var(--bg);color:var(--ink);font:15px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,
"Helvetica Neue","DejaVu Sans",sans-serif;font-variant-numeric:tabular-nums;-webkit-text-size-adjust:100%}
main{max-width:1080px;margin:0 auto;padding:36px 24px 64px}
header{display:flex;justify-content:space-between;align-items:flex-end;gap:24px;flex-wrap:wrap;margin-bottom:22px}
.brand{font-size:13px;letter-spacing:.08em;text-transform:uppercase;color:var(--muted);font-weight:600}
h1{font-size:28px;line-height:1.2;margin:4px 0 0;font-weight:650;letter-spacing:-.01em}
h2{font-size:19px;margin:0 0 4px;font-weight:650;letter-spacing:-.005em}
h3{font-size:15px;margin:26px 0 8px;font-weight:650}
h4{font-size:14px;margin:0;font-weight:650}h4 small{font-size:13px;color:var(--muted);font-weight:400;margin-left:5px}
p{margin:0 0 10px}.lead{color:var(--muted);max-width:96ch;margin-bottom:16px;text-wrap:pretty}
.badge{font-size:13px;border:1px solid var(--line);border-radius:99px;padding:2px 12px;color:var(--muted);
background:var(--card);white-space:nowrap;margin-left:6px}
section{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:24px 28px 26px;margin:0 0 20px}
.verdict{border-left:6px solid var(--muted)}.verdict.pass{border-left-color:var(--good)}
.verdict.fail{border-left-color:var(--bad)}.verdict.warn{border-left-color:var(--warn)}
.verdict h2{font-size:26px;line-height:1.25}.pass h2{color:var(--good)}.fail h2{color:var(--bad)}
.warn h2{color:var(--warn)}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(190px,1fr));gap:12px;margin:18px 0 14px}
.tile{background:var(--bg);border-radius:9px;padding:13px 16px}
.tile b{display:block;font-size:25px;font-weight:650;letter-spacing:-.01em;line-height:1.25}
.tile b small{font-size:15px;font-weight:500;margin-left:3px}.tile span{font-size:13px;color:var(--muted);display:block}
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:14px}
th{font-weight:600;color:var(--muted);font-size:13px;text-align:left;white-space:nowrap}
th,td{padding:7px 14px 7px 0;border-bottom:1px solid var(--line);vertical-align:top}
tr:last-child td{border-bottom:0}th:last-child,td:last-child{padding-right:0}
.log td:last-child{width:100%}.log td,.log th{padding-right:28px}.num{text-align:right;white-space:nowrap}
.tag{font-weight:650;white-space:nowrap}.tag.pass{color:var(--good)}.tag.fail{color:var(--bad)}.tag.warn{color:var(--warn)}
.bar{width:120px;height:8px;border-radius:4px;background:var(--grid);overflow:hidden;margin-top:7px}
.bar i{display:block;height:100%;background:var(--good)}.bar.fail i{background:var(--bad)}
.facts{display:grid;grid-template-columns:repeat(auto-fill,minmax(210px,1fr));gap:14px 24px;margin:0}
.facts dt{font-size:13px;color:var(--muted)}.facts dd{margin:0;font-weight:550;overflow-wrap:anywhere}
.sechead{display:flex;justify-content:space-between;align-items:baseline;gap:4px 24px;flex-wrap:wrap}
.panel{margin-top:20px;break-inside:avoid}
.head{display:flex;justify-content:space-between;align-items:baseline;gap:4px 24px;flex-wrap:wrap;margin-bottom:6px;
padding:0 52px 0 48px}
.legend{display:flex;flex-wrap:wrap;gap:2px 20px;font-size:13px;color:var(--muted)}
.key{white-space:nowrap}.key i{display:inline-block;width:20px;height:0;border-top:3px solid;vertical-align:middle;
margin-right:7px;border-radius:2px}
.key output{color:var(--ink);font-weight:600;margin-left:6px}
.key i.soft{border-top-width:2px;opacity:.5}.key i.pitch{color:var(--pitch)}.key i.roll{color:var(--roll)}
.key i.base{color:var(--base)}.key i.third{color:var(--third)}.key i.dash{color:var(--muted);border-top:2px dashed}
.key i.start,.key i.bandg,.key i.bandw{height:11px;border:1px solid var(--line);background:var(--settle)}
.key i.bandg{background:var(--bandg)}.key i.bandw{background:var(--bandw)}
.key i.mark{color:var(--bad);border-top-width:2px}
svg.plot{display:block;width:100%;padding:6px 52px 26px 48px;overflow:visible}
svg.hist{padding-top:24px}.stem.period{stroke:var(--bad);stroke-dasharray:5 4}
svg.plot text{font-size:12.5px;fill:var(--muted)}svg.plot .none{font-size:14px}
.frame{fill:none;stroke:var(--line)}
.grid,.zero,.level,.mark,.trace,.stem{fill:none;vector-effect:non-scaling-stroke;stroke-linejoin:round}
.grid{stroke:var(--grid)}.zero{stroke:var(--base);stroke-opacity:.55}.level{stroke:var(--muted);stroke-dasharray:5 4}
.mark{stroke:var(--bad);stroke-width:1.5}.settle{fill:var(--settle)}.good{fill:var(--bandg)}rect.warn{fill:var(--bandw)}
.trace{stroke-width:1.7}.trace.soft{stroke-width:1.1;stroke-opacity:.45}
.trace.pitch{stroke:var(--pitch)}.trace.roll{stroke:var(--roll)}.trace.base{stroke:var(--base)}.trace.third{stroke:var(--third)}
.area{stroke:none}.area.base{fill:var(--base);fill-opacity:.16}.area.pitch{fill:var(--pitch);fill-opacity:.16}
.area.roll{fill:var(--roll);fill-opacity:.16}.area.third{fill:var(--third);fill-opacity:.22}
.trace.base{stroke-width:1.4}.trace.bold{stroke-width:2.6}.stem{stroke:var(--muted);stroke-width:1}
.cursor{stroke:var(--ink);stroke-opacity:.55}
.xlabel{font-size:12.5px;color:var(--muted);text-align:center;margin:-4px 52px 0 48px}
.note{font-size:13px;color:var(--muted);margin:8px 0 0;max-width:86ch}.panel .note{margin-left:48px}
details{margin-top:12px}summary{cursor:pointer;font-weight:600;padding:4px 0}
pre{background:var(--bg);border-radius:8px;padding:14px 16px;overflow-x:auto;font:12.5px/1.5 ui-monospace,Consolas,
"DejaVu Sans Mono",monospace;margin:8px 0 0}
footer{color:var(--muted);font-size:13px;margin-top:26px}
@media (max-width:640px){main{padding:20px 12px 40px}section{padding:18px 16px 20px}h1{font-size:23px}
.verdict h2{font-size:22px}svg.plot{padding-left:40px;padding-right:34px}.xlabel{margin:-4px 34px 0 40px}
.head{padding:0}.tiles{grid-template-columns:1fr 1fr}.facts{grid-template-columns:1fr 1fr}
.tile b{font-size:20px}.tile b small{font-size:13px}
.rows th:nth-child(5),.rows td:nth-child(5){display:none}.panel .note{margin-left:0}}
@media print{@page{size:A4;margin:14mm}:root{color-scheme:light;--bg:#fff;--card:#fff;--ink:#14202d;--muted:#4d5a68;
--line:#d5dbe2;--grid:#e6eaee;--pitch:#0072b2;--roll:#c94f00;--base:#8593a3;--third:#007a5e;--good:#0b7a55;--bad:#b3261e;
--warn:#8f5b00;--settle:#14202d0d;--bandg:#0b7a5512;--bandw:#e6a0001c}
body{font-size:11pt;-webkit-print-color-adjust:exact;print-color-adjust:exact}main{max-width:none;padding:0}
section{border:0;border-radius:0;padding:0 0 4mm;margin:0 0 4mm}.verdict{border-left:6px solid;padding-left:5mm}
.tile{border:1px solid var(--line)}.record{display:none}.sechead,.lead,h3{break-after:avoid}
.tiles{grid-template-columns:repeat(4,1fr);gap:8px}.tile{padding:8px 11px}.tile b{font-size:15pt}tr{break-inside:avoid}}
"""

# Reads the traces back from the drawn paths, so the page carries no second copy of the data. Works without it, too.
JS = """
(()=>{'use strict';const W=4000,H=2000;
const plots=[...document.querySelectorAll('svg.plot[data-x1]')].map(svg=>({svg,frame:svg.querySelector('.frame'),
cursor:svg.querySelector('.cursor'),outs:svg.parentNode.querySelectorAll('.key output'),
x1:+svg.dataset.x1,y0:+svg.dataset.y0,y1:+svg.dataset.y1,lines:null}));
function lines(p){if(p.lines)return p.lines;p.lines=[...p.svg.querySelectorAll('path[data-k]')].map(el=>{
const xs=[],ys=[];for(const run of el.getAttribute('d').split('M').slice(1)){const [start,rest]=run.split('l');
let [x,y]=start.split(' ').map(Number);const d=rest.trim().split(' ').map(Number);
for(let i=0;i<d.length;i+=2){x+=d[i];y+=d[i+1];xs.push(x);ys.push(y)}}return{k:+el.dataset.k,xs,ys}});return p.lines}
function nearest(xs,x){let a=0,b=xs.length-1;while(b-a>1){const m=(a+b)>>1;if(xs[m]<x)a=m;else b=m}
return x-xs[a]<xs[b]-x?a:b}
function digits(span){return Math.max(0,Math.min(5,2-Math.floor(Math.log10(span/10))))}
function show(f){for(const p of plots){p.cursor.setAttribute('x1',100*f+'%');p.cursor.setAttribute('x2',100*f+'%');
p.cursor.setAttribute('visibility','visible');const box=p.svg.getBoundingClientRect();
if(box.bottom<0||box.top>innerHeight)continue;for(const l of lines(p)){const i=nearest(l.xs,f*W);
const v=p.y1-l.ys[i]/H*(p.y1-p.y0);p.outs[l.k].textContent=v.toFixed(digits(p.y1-p.y0)).replace('-','\\u2212')}
const label=p.svg.parentNode.querySelector('.xlabel');if(label)label.textContent='time '+(f*p.x1).toFixed(2)+' s'}}
function hide(){for(const p of plots){p.cursor.setAttribute('visibility','hidden');p.outs.forEach(o=>o.textContent='');
const label=p.svg.parentNode.querySelector('.xlabel');if(label)label.textContent='time, s'}}
for(const p of plots){p.svg.addEventListener('pointermove',e=>{const b=p.frame.getBoundingClientRect();
const f=(e.clientX-b.left)/b.width;if(f>=0&&f<=1)show(f);else hide()});p.svg.addEventListener('pointerleave',hide)}
})();
"""


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numeric: Sequence[int] = (), cls: str = "") -> str:
    """A table from cells that are already HTML; columns in ``numeric`` are right-aligned."""
    mark = [' class="num"' if k in numeric else "" for k in range(len(head))]
    top = "".join(f"<th{mark[k]}>{escape(text)}</th>" for k, text in enumerate(head))
    body = "".join("<tr>" + "".join(f"<td{mark[k]}>{c}</td>" for k, c in enumerate(row)) + "</tr>" for row in rows)
    return f'<div class="scroll"><table class="{cls}"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def facts(items: Iterable[tuple[str, str]]) -> str:
    """A grid of names and values (plain text)."""
    cells = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in items)
    return f'<dl class="facts">{cells}</dl>'


def tile(value: str, unit: str, caption: str) -> str:
    """One headline figure."""
    small = f"<small>{escape(unit)}</small>" if unit else ""
    return f'<div class="tile"><b>{escape(value)}{small}</b><span>{escape(caption)}</span></div>'


def section(title: str, lead: str, body: str, cls: str = "", key: str = "") -> str:
    """A card. ``title`` and ``lead`` are plain text; ``body`` and ``key`` (a legend beside the title) are HTML."""
    text = f'<p class="lead">{escape(lead)}</p>' if lead else ""
    head = f'<div class="sechead"><h2>{escape(title)}</h2>{key}</div>'
    return f'<section class="{cls}">{head}{text}{body}</section>'


def details(title: str, text: str) -> str:
    """Collapsed preformatted text."""
    return f"<details><summary>{escape(title)}</summary><pre>{escape(text)}</pre></details>"


def page(title: str, header: str, sections: Sequence[str], footer: str) -> str:
    """The whole document."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{CSS}</style></head><body><main>"
        f"{header}{''.join(sections)}<footer>{escape(footer)}</footer></main><script>{JS}</script></body></html>\n"
    )
