"""All English text that stands on the page, by where it stands. What is wrong is said where it is raised."""

# The page itself.
TITLE = "jshape studio"
COMPUTING = "computing …"
NO_RESULT = "no result"
OWN_SHAPER = "own shaper"
OWN_SHAPER_MEANS = "each axis has a shaper of its own"
DARK_OR_LIGHT = "dark or light"
CLOSE = "Close"
NOT_COMPUTED = "this could not be computed: {kind}; details are in the terminal"
PANELS = MACHINE, SHAPER, AWAY, PRINTER, LEARN = "Machine", "Shaper", "Take away", "Printer", "Learn"

# The drawing.
DRAWING = "Machine: shaped, and unshaped as a shadow"
DRAWING_MEANS = "The machine in motion: without a shaper as a shadow, with it in front"
BOTH_ENDS = "{leaf}: small {low}, large {high}"
PLAY, PAUSE = "Play", "Pause"
TIME_OF_DRAWING = "time of the drawing"

# The charts.
RESPONSE = "Response"
SWAY = "Sway"
ENERGY = "Energy"
ENERGY_AGAINST_POSITION = "Energy against position"
ENERGY_AGAINST_TIME = "Energy against time"
SENSITIVITY = "Sensitivity"
SENSITIVITY_DRAFT = "Sensitivity (draft)"
SENSITIVITY_OVER = "Sensitivity over {count} plants"
SENSITIVITY_OF_NOTHING = "Sensitivity: mark something ±"
VIBRATION = "V(ω, ζ)"
VIBRATION_TITLE = "V(ω, ζ): linear vibration"
SPECTRUM = "Spectrum"
SPECTRUM_TITLE = "Spectrum of the response"
IMPULSES = "Impulses: drag a bar's end"
WHAT_IS_SHOWN = "what is shown"
TIME = "time (s)"
POSITION = "position ({unit})"
DEFLECTION = "deflection ({unit})"
ENERGY_UNIT = "energy (J)"
FREQUENCY = "frequency (Hz)"
VIBRATION_UNIT = "V (%)"
AMPLITUDE = "amplitude"
AMPLITUDE_OF = "amplitude ({unit})"
MODE = "mode"
LEAVES = "residual energy {shaped:.4g} J{share}{worst} · shaper {duration:.4g} s · move {move_time:.4g} s"
SHARE = " ({share:.3g} of the unshaped {unshaped:.4g} J)"
ENERGY_AT_WORST = ", over {leaf} at worst {most:.4g} J"
VIBRATION_AT_WORST = ", over {leaf} at worst {most:.3g} % vibration"
ABOVE = "{name} (above)"
DIVERGED = "the plant diverged: it has left the region from which it returns to rest"

# Machine.
WHICH_MACHINE = "machine"
OR_A_FILE = "or a file: problem, MJCF, URDF, measured CSV"
REJECTED_FILE = "a file must have at most {most} bytes and end in .toml, .xml, .urdf or .csv"
DRIVEN = "joint of {name} that follows the command"
UNCERTAIN = "± marks a number as uncertain, in percent"
UNCERTAIN_BY = "{leaf}: uncertain by"
RECORD = "{name}: time in the first column, a channel in each other"
RECORD_OF = "record of"
RECORDS = {
    "ring-down": "a machine left to itself",
    "step": "a step of the command",
    "sweep": "a sweep of the command",
    "spectrum": "a power spectral density over Hz",
    "frequency-response": "a frequency response over Hz: real, imaginary",
}
COMMAND_COLUMN = "column of the command"
FIND_MODES = "Find its modes"

# Shaper.
CLOSED_FORMS = "Closed forms"
EACH_IMPULSE = "Impulses: amplitude, and time in s"
ADD, REMOVE = "add", "remove"
AMPLITUDE_NUMBER, TIME_NUMBER = "amplitude {number}", "time {number}"
IMPULSE = "{amplitude:.4g} at {time:.4g} s"
COMPARE = "Compare"
PIN = "Pin this design"
TAKE, TAKE_PIN, REMOVE_PIN = "take", "take {name}", "remove {name}"
PIN_LEAVES = " · leaves {energy:.3g} J{worst}"
TUNE_TITLE = "Tune: least residual energy"
TUNE = "Tune"
COUNT, AMPLITUDES, DURATION = "impulses", "amplitudes", "duration, s"
DURATIONS_BETWEEN, DURATION_FREE = "{low} to {high}", "free"
STEP, BEST = "step", "best, J"
FRONT_TITLE = "Pareto front: what duration buys"
COMPUTE = "Compute"
COUNT_UP_TO, DURATIONS = "impulses up to", "durations"
FRONT_DONE = "{message}; click on a point, or choose it"
FRONT_POINT = "{name}, {duration:.3g} s: {objective:.3g} J"
FRONT_CHOOSE = "a point of the front"
FRONT_DURATION, FRONT_LEFT, FRONT_CLOSED_FORMS = "duration (s)", "left, J", "closed forms"

# What takes long.
STOP, STOPPING, STARTS = "Stop", "stopping …", "the process starts …"
BEST_SO_FAR = "{line}, best {best:.4g}{unit}"

# Take away.
FORMAT = "format of the shaper"
OPTIONS = {"sample_time": "sample time, s", "modes": "modes: omega,zeta; … (rad/s, –)"}
EMPTY_OPTIONS = "options that may stay empty"
DOWNLOAD, SHOW, BINARY = "Download", "Show", "(binary)"
COPY_LINK = "Copy link"
PROBLEM_FILE, MACHINE_FILE, SCRIPT = "Problem file", "Machine file", "Python script"
RESPONSES_CSV, SENSITIVITY_CSV = "Responses, CSV", "Sensitivity, CSV"
CHARTS = {
    "position": RESPONSE, "deflection": "Sway or energy", "sensitivity": SENSITIVITY,
    "vibration": "V(ω, ζ) or spectrum", "impulses": "Impulses", "printer-x": "Printer, axis x",
    "printer-y": "Printer, axis y",
}  # fmt: skip
CHART_SHOWN, SVG = "chart as it is shown", "SVG"
LINK_CARRIES = "A link carries machine, move and shapers; jshape studio LINK opens it."
TUNE_GIVES = "jshape tune problem.toml gives the numbers of Tune"

# Printer.
PRINTER_TITLE = "A printer's shaper from its accelerometer"
PRINTER_FILES = "Klipper's raw_data_*.csv or resonances_*.csv; several of an axis are loads that share a shaper"
DROP_CSV = "drop CSV files, or +"
REJECTED_RECORD = "a record must have at most {most} bytes"
AXIS_OF_FILE, REMOVE_FILE = "axis of {name}", "remove {name}"
KLIPPER, DAMPING_RATIO, CORNER = "Klipper", "damping ratio", "corner, mm/s"
KLIPPER_VERSIONS = {"current": "current", "2024": "December 2024"}
CHOOSE_SHAPER = "Choose a shaper"
PRINTER_DONE = "done: choices and lines to paste are beside this"
PRINTER_HINT = "Drop the records of your printer on the left, then choose a shaper."
PRINTER_COLUMNS = {
    "name": "shaper", "frequency": "Hz", "vibration": "left (%)", "smoothing": "blur (mm)", "max_accel": "max_accel",
    "duration": "ms",
}  # fmt: skip
PRINTER_LEGEND = (
    "* Klipper's choice; left: of the measured vibration; blur: Klipper's smoothing of corners; max_accel: the "
    "greatest acceleration, mm/s²; ms: the shaper's duration. Dashed: Klipper's shapers; solid: tuned ones."
)
PRINTER_CHART = "Axis {axis}: spectrum, and what shapers leave"
DENSITY, VIBRATION_LEFT, AFTER = "density over its greatest", "vibration left (%)", "after {name}"
KLIPPERS_CHOICE, OURS = "Klipper's choice: {choice}", "Ours for stock firmware: {choice}"
PASTE, COPY = "Lines for printer.cfg", "Copy"

# Learn.
LEARN_TITLE = "Moves of a machine whose payload changes unannounced"
ENVIRONMENT, PRESET, STRATEGY_EACH = "environment", "preset", ("strategy A", "strategy B")
ENVIRONMENTS = {
    "CranePayload": "Crane, bob of unknown mass",
    "DuffingPayload": "Payload on a nonlinear spring",
    "FlexibleLinkPayload": "Flexible link with coins",
    "HoistingCrane": "Crane that hoists",
}
MOVES, SEED, EPISODES, SEEDS = "moves", "seed", "episodes", "seeds"
WATCH, JUDGE = "Watch", "Judge all"
WATCHED = "done: {count} moves are beside this"
LEADERBOARD = "Leaderboard of this environment and preset"
LEADERBOARD_OF = "{environment}, {preset}: {seeds:g} × {episodes:g} episodes"
LEAST_REGRET = " is the least regret"
LEARN_HINT = "Choose two strategies on the left, then watch them, or judge all."
EPISODE_MEANS = "The machine in an episode under strategy A and under strategy B"
LEARN_COLUMNS = {
    "policy": "strategy", "residual": "left (%)", "move_time": "move (s)", "recovery": "moves until recovered",
    "recovered": "within two moves (%)", "regret": "regret (1000 ×)",
}  # fmt: skip
LEARN_LEGEND = (
    "Left: energy after a move, of the bare move's; recovered: less than 5 % left after the payload has changed; "
    "regret: cost of a move beyond the oracle's. A click on a heading sorts. More episodes: jshape evaluate."
)
MOVE, LEFT_OF_MOVE = "move", "left, %"
