#pragma once

#include <string_view>

namespace wagonsight::report {

// The page's style: the colours of the unit's own page, made to be printed too.
inline constexpr std::string_view kStyle = R"css(
:root{--ground:#f3f4f2;--card:#fff;--line:#dfe3e0;--ink:#16201d;--soft:#55625d;--faint:#65716c;--accent:#0f766e;
--ok:#15803d;--ok-soft:#dcf3e3;--warn:#a15c07;--warn-soft:#fdf0d5;--bad:#b42318;--bad-soft:#fde4e1;--sunk:#eef0ee;
font:15px/1.5 Inter,system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans","Liberation Sans",sans-serif;color-scheme:light}
@media (prefers-color-scheme:dark){:root{--ground:#0d1211;--card:#151c1a;--line:#27322f;--ink:#e8eeeb;--soft:#a9b6b0;
--faint:#8e9c96;--accent:#2dd4bf;--ok:#4ade80;--ok-soft:#12351f;--warn:#fbbf24;--warn-soft:#3a2a08;--bad:#ff8378;
--bad-soft:#461a16;--sunk:#1b2422;color-scheme:dark}}
*{box-sizing:border-box}body{margin:0;background:var(--ground);color:var(--ink)}
main{max-width:1140px;margin:0 auto;padding:22px 24px 60px;display:grid;gap:16px;grid-template-columns:minmax(0,1fr)}
h1,h2,h3,p,ul,table{margin:0;padding:0}h1{font-size:26px;letter-spacing:-.02em;line-height:1.2}
h2{font-size:17px;letter-spacing:-.01em;margin-bottom:4px}h3{font-size:13.5px}
.top{color:var(--faint);font-size:13.5px}
section{background:var(--card);border:1px solid var(--line);border-radius:14px;padding:18px 22px}
section>p{color:var(--soft);margin-bottom:12px;max-width:86ch}
.verdict{border-left:6px solid var(--tone);}.verdict p{font-size:16px;margin:6px 0 0}
.g0{--tone:var(--ok);--tone-soft:var(--ok-soft)}.g1{--tone:var(--warn);--tone-soft:var(--warn-soft)}.g2{--tone:var(--bad);--tone-soft:var(--bad-soft)}
.findings{list-style:none;display:grid;gap:8px}.findings li{border-left:4px solid var(--tone);background:var(--sunk);border-radius:0 8px 8px 0;padding:7px 14px}
.findings b{font-weight:650}.findings span{color:var(--soft)}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums;font-size:14px}
th,td{text-align:right;padding:5px 10px;border-bottom:1px solid var(--line)}th{color:var(--faint);font-weight:600;font-size:12.5px;vertical-align:bottom}
th:first-child,td:first-child,td.text,th.text{text-align:left}.scroll{overflow-x:auto}
td.bad{color:var(--bad);font-weight:650}td.warn{color:var(--warn);font-weight:650}td.none{color:var(--faint)}
.bar{display:inline-block;height:9px;border-radius:5px;background:var(--accent);vertical-align:middle;margin-left:8px}
.grid2{display:grid;gap:16px;grid-template-columns:repeat(auto-fill,minmax(310px,1fr))}
figure{margin:0}figcaption{font-size:13px;color:var(--soft);display:flex;justify-content:space-between;gap:8px;margin-bottom:4px}
figcaption b{color:var(--ink);font-weight:600;overflow:hidden;text-overflow:ellipsis;white-space:nowrap}
.photo{width:100%;display:block;background:#20282a;border-radius:8px}
.dots{stroke:#fff;stroke-opacity:.85;stroke-linecap:round;fill:none}.vectors{stroke:#34e07a;fill:none;stroke-linecap:round}
.vectors.under{stroke:#000;stroke-opacity:.7}.crosses{stroke:#ff4d3d;fill:none}
.coverage{width:100%;display:block;border-radius:8px;background:var(--sunk)}.coverage .filled{fill:var(--accent)}
.coverage .empty{fill:var(--bad-soft)}.coverage rect{stroke:var(--card);stroke-width:3}.corner-dots{stroke:var(--ink);stroke-opacity:.55;stroke-linecap:round}
.maps{display:grid;gap:20px;grid-template-columns:repeat(auto-fit,minmax(min(380px,100%),1fr))}
.map{width:100%;max-height:560px;background:var(--sunk);border-radius:8px}.map text{font:600 17px system-ui,sans-serif;fill:var(--ink)}
.map .name{paint-order:stroke;stroke:var(--card);stroke-width:5px;stroke-linejoin:round}
.grid{stroke:var(--ink);stroke-opacity:.13;fill:none}.axes{stroke:var(--ink);stroke-width:2.5;fill:none}
.gaze{stroke:var(--ink);stroke-width:3.5;fill:none}.sensor{fill:var(--accent);stroke:var(--card);stroke-width:2.5}
.level0{fill:#1a7f5a;background:#1a7f5a}.level1{fill:#3aa76d;background:#3aa76d}.level2{fill:#86c46c;background:#86c46c}.level3{fill:#d3d864;background:#d3d864}
.level4{fill:#f5c24c;background:#f5c24c}.level5{fill:#ef9440;background:#ef9440}.level6{fill:#dd5b3a;background:#dd5b3a}.level7{fill:#a92a36;background:#a92a36}
.legend{display:flex;flex-wrap:wrap;gap:4px 14px;font-size:13px;color:var(--soft);margin-top:10px}.legend i{display:inline-block;width:14px;height:14px;border-radius:4px;margin-right:5px;vertical-align:-2px}
summary{cursor:pointer;color:var(--accent);margin:12px 0}ul.remarks{padding-left:20px;color:var(--soft)}
@media print{body{background:#fff}section{break-inside:avoid}}
)css";

}  // namespace wagonsight::report
