// Weights of policies that stand in files beside the page: walk.py writes them.

/** Load the weights of a policy of data.policies; rejects with a sentence that says why not. */
export async function loadWeights(name, policy) {
  await runFile(policy.file).catch(() => {
    throw new Error(
      `The network of the ${name} is in the file ${policy.file}, which must be in the same folder as this page.`,
    );
  });
  policy.weights = globalThis.jansenNetworks?.[policy.file];
  if (!policy.weights)
    throw new Error(
      `The file ${policy.file} must contain the network of the ${name}, but does not.`,
    );
}

/** Run a script beside the page; of all ways to read a file this one works without a server, too. */
function runFile(src) {
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    Object.assign(script, { src, onload: resolve, onerror: reject });
    document.head.append(script);
  });
}
