"""``python -m app view``: a page in the browser that controls the renderer."""

import asyncio
from typing import Annotated

import typer

from app.cli.options import (
    AUTO,
    SCENE,
    Animation,
    Bounces,
    Lighting,
    ModelNames,
    Provider,
    SceneFile,
    SceneJson,
    StrictDevice,
    Studio,
    Variant,
)
from app.io.terminal import note
from app.network.selection import DEFAULT_MODEL
from app.settings import TONE_MAPS, Settings, parse_size

SERVER = "Server"


def view(
    scene: SceneFile = None,
    camera: Annotated[str | None, typer.Option(
        help="auto, a camera of the scene, or a FILE.json.", metavar="auto|NAME|FILE.json",
        show_default="the scene's own", rich_help_panel=SCENE)] = None,
    lighting: Lighting = None,
    scene_json: SceneJson = None,
    studio: Studio = None,
    variant: Variant = None,
    animation: Animation = None,
    size: Annotated[str, typer.Option(
        help="Pixels, until a page reports the size of its window.", metavar="WxH",
        rich_help_panel=SCENE)] = "1024x768",
    host: Annotated[str, typer.Option(
        help="Address to listen on; unless it is this machine's own, the link contains a token.", metavar="ADDRESS",
        rich_help_panel=SERVER)] = "127.0.0.1",
    port: Annotated[int, typer.Option(
        help="Port; 0 for a free one.", min=0, max=65535, metavar="N", rich_help_panel=SERVER)] = 0,
    target_fps: Annotated[float, typer.Option(
        help="Frames per second to reach while something moves, by drawing frames at down to half the size; 0 draws "
             "all at full size.", min=0, max=1000, metavar="N", rich_help_panel=SERVER)] = 10.0,
    model: ModelNames = [DEFAULT_MODEL],  # noqa: B006
    bounces: Bounces = None,
    provider: Provider = AUTO,
    strict_device: StrictDevice = False,
) -> None:
    """View a scene live in a browser: orbit, drag lights, compare models with each other and with the reference.

    Serves one page and prints its link; Ctrl-C ends the program. Needs the extra [bold]view[/bold], and for the
    reference [bold]export[/bold].

    [bold]Examples[/bold]

    [cyan]python -m app view[/cyan]  [dim]# the embedded Cornell box[/dim]

    [cyan]python -m app view sponza.glb --lighting sun --model radiosity[/cyan]  [dim]# another model[/dim]

    [cyan]python -m app view room.obj --host 0.0.0.0 --port 8080[/cyan]  [dim]# for others, by a secret link[/dim]
    """
    from app.cli.render import choose_camera
    from app.extras import extra_module
    from app.gl.context import Device
    from app.io.color_management import default_views
    from app.load import lighting_of, load_for_editing
    from app.network.providers import check_provider
    from app.network.selection import NONE, all_models, environment_notices, find_model, load_models, shades_environment
    from app.paths import data_dir
    from app.view.model_renderer import VIEWABLE_OUTPUTS
    from app.view.protocol import Choices
    from app.view.server import EXTRA, serve
    from app.view.session import Session
    from app.view.state import State

    extra_module("aiohttp", EXTRA)
    check_provider(provider)
    settings = Settings(size=parse_size(size), bounces=bounces, provider=provider, strict_device=strict_device)
    names = [name for name in model if name != NONE]
    files = [find_model(name) for name in names]
    Device(strict_device).close()  # raises if there is no OpenGL
    file = (scene or data_dir() / "cornell-box.obj").resolve()
    loaded = load_for_editing(file, lighting=lighting_of(lighting, studio), scene_json=scene_json, variant=variant,
                              animation=animation, studio=studio is not False)
    load_models(files, settings, loaded.scene.environment is not None)  # raises if they don't fit together
    for notice in (*loaded.scene.notices, *environment_notices(loaded.scene, files)):
        note(notice)
    shading = [name for name, network in zip(names, files, strict=True) if shades_environment(network)]
    indirect = [name for name in names if name not in shading] or [NONE]
    models = tuple(dict.fromkeys((*all_models(), *indirect)))
    movable = {name: members for name, members in loaded.objects.items()
             if all(loaded.scene.instances[i].motion is None for i in members)}
    first_view = choose_camera(loaded.scene, camera).at(0.0)
    state = State(settings.size, first_view, loaded.scene.lights[:loaded.own_lights], indirect[0],
                  environment=next(iter(shading), ""), bounces=bounces)
    choices = Choices(models, VIEWABLE_OUTPUTS, (*TONE_MAPS, *default_views()), movable)
    session = Session(file, loaded, state, choices, provider, target_fps)
    asyncio.run(serve(session, host, port,
                      lambda link: typer.echo(f"Afterglow is at {link}\nCtrl-C ends it")))
    typer.echo("ended")
