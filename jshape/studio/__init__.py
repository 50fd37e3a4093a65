"""The studio, ``jshape studio``: a page in the browser, on this machine alone, whose sliders move the curves.

It has no mathematics of its own. The page is there before JAX, which a worker loads: what needs it is imported where it
is called. Nothing of this is imported by any other command.

The state of a page, and what is computed of it:

- ``state``: a problem file and the impulses of a shaper.
- ``changes``: what makes another state of it.
- ``machine_file``: a machine described in MJCF or URDF.
- ``live``: the newest state wins.
- ``curves``: the curves of a state, by jshape's public functions.
- ``results``: the same as plain arrays, without JAX.
- ``work``: what takes long, in a process of its own.
- ``tasks``: its tasks: tune, the Pareto front, a printer …
- ``episodes``: its tasks for strategies that learn.

What the browser shows, beside three scripts:

- ``page``: the layout.
- ``tab``: one tab: its state, and what is drawn for it.
- ``panels``: the left side.
- ``charts``: the charts of the machine.
- ``panel_charts``: the charts of the panels.
- ``drawings``: the drawings that move.
- ``words``: all English on the page.
- ``takeaway``: what can be saved.
- ``link``: what an address carries.

The server:

- ``server``: on 127.0.0.1 alone.
- ``guard``: who may talk to it.
- ``own_code``: whether problem files may name code.

The library of the page was chosen by one prototype in each of three: a slider that changes a curve of 1,000 points in a
headless Chromium, 60 key presses, from the key to the first frame with the new value (x86-64, two cores):

=========================  ==============  ==========  ================
..                         NiceGUI 3.18    Panel 1.9   Shiny 1.8
=========================  ==============  ==========  ================
median                     26 ms           73 ms       440 ms
95th percentile            43 ms           78 ms       455 ms
start of the server        1.3 s           1.5 s       1.0 s
first page                 1.4 s           1.3 s       0.8 s
memory of the server       85 MB           79 MB       76 MB
installed, with all needs  130 MB          393 MB      120 MB
requests elsewhere         none            none        none
licence                    MIT             BSD-3       MIT
=========================  ==============  ==========  ================

Shiny's sliders wait a quarter of a second before they send a value. All three answer a headless browser and are
maintained. NiceGUI brings its charts (Apache ECharts), too, and takes an ASGI middleware, which the guard is.
"""
