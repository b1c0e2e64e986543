"""What the page says while there is nothing to show, and before the token is known: what to do."""

EMPTY = """<h2>No vehicle is heard yet</h2>
<p>The page fills by itself as soon as a vehicle speaks. If none comes:</p>
<ol>
<li>On the vehicle, is the daemon running? <code>systemctl status landslope</code> or <code>landslope run</code></li>
<li>Does it know this machine or the router? Its setting <code>zenoh.connect</code> must name the endpoint that
<code>landslope monitor --listen</code> or the router listens on.</li>
<li>Is it the right name? <code>--vehicle</code> and <code>?vehicle=</code> in the address must be the vehicle's
<code>vehicle.name</code>.</li>
<li>Does the network let it through? Try <code>landslope watch --connect tcp/ADDRESS:7447</code> on the vehicle.</li>
</ol>
<p>To see the page at work without a vehicle, replay a flight into it:
<code>landslope replay FLIGHT --realtime --publish</code> and <code>landslope monitor --scouting</code>.</p>"""

_LOGIN = """<!doctype html><html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>landslope monitor: log in</title>
<style>:root{color-scheme:light dark}body{font:20px/1.4 sans-serif;margin:0;color:#000;background:#fff}
main{max-width:30em;margin:0 auto;padding:1em}input,button{font-size:24px;padding:8px 12px;box-sizing:border-box}
input{width:100%}button{min-height:48px}.wrong{background:#a80019;color:#fff;padding:8px 12px;border-radius:8px}
@media(prefers-color-scheme:dark){body{color:#f4f6fa;background:#0e1116}}</style></head>
<body><main><h1>landslope monitor</h1>MESSAGE
<form method="post" action="/login"><p><label for="token">Token</label><br>
<input id="token" name="token" type="password" required autofocus autocomplete="current-password"></p>
<p><button>Watch</button></p></form>
<p>The token is the first line of the file that the monitor was started with (<code>--token-file</code>). The
person who started it can read it to you. This page shows vehicles; it cannot command them.</p></main></body></html>"""

LOGIN_PAGE = _LOGIN.replace("MESSAGE", "").encode()
WRONG_TOKEN_PAGE = _LOGIN.replace(
    "MESSAGE", '<p class="wrong" role="alert">That is not the token. Check it and try again.</p>'
).encode()
