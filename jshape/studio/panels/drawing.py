"""A drawing that moves, with its button and its slider; ``scene.js`` draws it."""

from nicegui import ui

from jshape.studio import words


def drawing(name: str, meaning: str) -> None:
    """The drawing and its controls, one below the other.

    Args:
        name: ``"scene"`` or ``"episode"``, of its elements.
        meaning: of the drawing, for those who do not see it.
    """
    script = f"jshape{name.capitalize()}"
    canvas = f'<canvas id="{name}" style="width:100%;height:100%" role="img" aria-label="{meaning}"></canvas>'
    controls = f"""<div class="studio-controls">
<button id="{name}-play" onclick="{script}.toggle(this)" data-play="{words.PLAY}" data-pause="{words.PAUSE}"
>{words.PAUSE}</button>
<input id="{name}-at" type="range" min="0" max="1000" value="0" aria-label="{words.TIME_OF_DRAWING}"
  oninput="{script}.scrub(this.value / 1000)"><span id="{name}-time"></span></div>"""
    # Of what is uncertain; its height stays while there is nothing to say.
    ui.html(f'<div id="{name}-note" class="text-xs" style="min-height:16px"></div>', sanitize=False)
    ui.html(canvas, sanitize=False).style("flex:1;min-height:0")
    ui.html(controls, sanitize=False)
