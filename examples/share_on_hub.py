"""Share a trained policy on the Hugging Face Hub: its files, an ONNX model and a model card.

Run the example as follows:

    python examples/share_on_hub.py [REPOSITORY]

REPOSITORY is a name such as me/jansen-walker. Without it, the files stay in the folder `hub`, and
you need no account. The example requires huggingface_hub and the extra `export`; see
docs/frameworks.md.
"""

import json
import shutil
import sys
from pathlib import Path

from huggingface_hub import HfApi, ModelCard, ModelCardData

from agents.export import export
from jansen_env import policies
from jansen_env.policies import pretrained

ENV = "JansenWalkerBuilt-v0"
folder = Path("hub")
folder.mkdir(exist_ok=True)
for name in ("ppo.json", "ppo.safetensors"):
    shutil.copy(Path(policies.__file__).parent / ENV / name, folder)
export("pretrained", ("onnx",), folder, name="ppo", env_id=ENV)
policy = pretrained.load(ENV)
about = {name: policy.description[name] for name in ("observation", "action", "training")}
scores = policy.description["scores"]["overall"]
data = ModelCardData(
    library_name="jansen-env", license="mit", tags=["reinforcement-learning", "gymnasium", ENV]
)
card = f"""---
{data}
---

# A policy of {ENV}

`jansen_env.policies.pretrained.load_file("ppo.json")`, or `ppo.onnx` with onnxruntime. Trained and
scored in simulation only: return {scores["return"][0]:.0f}, falls {scores["falls"][0]:.3f}.

```json
{json.dumps(about, indent=1)}
```
"""
ModelCard(card).save(folder / "README.md")
if len(sys.argv) > 1:
    HfApi().create_repo(sys.argv[1], exist_ok=True)
    HfApi().upload_folder(repo_id=sys.argv[1], folder_path=folder)
print(f"{folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}")
