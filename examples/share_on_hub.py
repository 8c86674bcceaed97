"""A trained policy as a repository of the Hugging Face Hub: its files, as ONNX too, and its card.

python examples/share_on_hub.py [REPOSITORY]

Without a name, such as me/jansen-walker, it stays in the folder `hub` and needs no account. Needs
huggingface_hub and the extra `export`: docs/frameworks.md.
"""

import shutil
import sys
from pathlib import Path

from huggingface_hub import HfApi, ModelCard, ModelCardData

from agents.export import export
from jansen_env import policies

ENV = "JansenWalkerBuilt-v0"
folder = Path("hub")
shutil.copytree(Path(policies.__file__).parent / ENV, folder, dirs_exist_ok=True)
(_, card), _ = export("pretrained", ("onnx",), folder, name="ppo", env_id=ENV, episodes=1)
data = ModelCardData(
    library_name="jansen-env", license="mit", tags=["reinforcement-learning", "gymnasium", ENV]
)
ModelCard(f"---\n{data}\n---\n\n{card.read_text(encoding='utf-8')}").save(folder / "README.md")
card.unlink()
if len(sys.argv) > 1:
    HfApi().create_repo(sys.argv[1], exist_ok=True)
    HfApi().upload_folder(repo_id=sys.argv[1], folder_path=folder)
print(f"{folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}")
