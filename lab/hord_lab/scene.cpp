// hord-lab scene: questions about a scene file.
#include <optional>

#include <fmt/format.h>

#include "common/cli/progress.h"
#include "firmware/recipes/recipe_file.h"
#include "lab/hord_lab/commands.h"
#include "lab/scene/scene_needs.h"

namespace hord::lab {

void add_scene(CLI::App& program, Exit& status) {
    auto* scene = program.add_subcommand("scene", "Ask about a scene");
    scene->require_subcommand(1);
    struct Arguments {
        std::string scene, recipe;
        bool only_named = false;
        double tolerance = 0.05;
        int threads = 0;
    };
    auto arguments = std::make_shared<Arguments>();
    auto* needs = scene->add_subcommand("needs", "What each of its effects changes and costs, and which it requires");
    needs->add_option("SCENE", arguments->scene, "Scene (TOML, docs/scene.md)")->required();
    needs
        ->add_option("--tolerance", arguments->tolerance,
                     "Change of a feature that does not matter: bin pitches, and share of light (default 0.05)")
        ->check(in_range(0.0, 10.0));
    needs->add_option("--recipe", arguments->recipe, "Recipe whose verdict counts (TOML); without it the default");
    needs->add_flag("--only-named", arguments->only_named, "Do not try effects that the scene does not name");
    needs->add_option("--threads", arguments->threads, "Threads (0: one a core)")->check(in_range(0, 256));
    needs->footer("Example: hord-lab scene needs hal_sim/scenes/real-cell.toml --tolerance 0.05");
    needs->callback([arguments, &status] {
        const auto loaded = sim::load_scene(arguments->scene);
        if (!loaded) return void(status = complain(loaded.error()));
        const auto recipe = firmware::recipe_or_default(arguments->recipe);
        if (!recipe) return void(status = complain(recipe.error()));
        std::optional<Progress> progress(std::in_place, "needs of " + loaded->name);
        const auto found = needs_of(*loaded,
                                    {arguments->tolerance, arguments->threads, recipe->recipe, !arguments->only_named,
                                     [&](double done) { progress->show(done); }});
        progress.reset();
        if (!found) return void(status = complain(found.error()));
        fmt::print("{}", table_of(*found));
    });
}

}  // namespace hord::lab
