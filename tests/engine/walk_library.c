/* Walk a robot by the engine's library alone, without Python, and print a hash of the walk.

       walk_library LIBRARY WALK

   LIBRARY is the engine for this platform. WALK is what tests/engine/library_walk.py writes: the
   memory of the kernel `episode_control_step`, its arguments, and actions. The hash is that of each
   step's observation, state and reward, so it must be the same on every platform. */

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
#else
#include <dlfcn.h>
#endif

typedef int64_t (*kernel)(int64_t slots);

static FILE *walk;

static void fail(const char *what) {
    fprintf(stderr, "walk_library: %s\n", what);
    exit(1);
}

static int64_t read_number(void) {
    int64_t number;
    if (fread(&number, sizeof number, 1, walk) != 1) fail("the walk is cut short");
    return number;
}

static kernel load_kernel(const char *library, const char *name) {
#ifdef _WIN32
    HMODULE module = LoadLibraryA(library);
    if (module == NULL) fail("the library cannot be loaded");
    return (kernel)(void *)GetProcAddress(module, name);
#else
    void *module = dlopen(library, RTLD_NOW);
    if (module == NULL) fail(dlerror());
    return (kernel)dlsym(module, name);
#endif
}

/* FNV-1a, 64 bits. */
static uint64_t add_to_hash(uint64_t hash, const unsigned char *bytes, int64_t size) {
    for (int64_t i = 0; i < size; i++) hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
    return hash;
}

int main(int count, char **arguments) {
    if (count != 3) fail("usage: walk_library LIBRARY WALK");
    kernel control_step = load_kernel(arguments[1], "episode_control_step");
    if (control_step == NULL) fail("the library has no episode_control_step");
    walk = fopen(arguments[2], "rb");
    if (walk == NULL) fail("the walk cannot be opened");

    int64_t block_count = read_number();
    unsigned char **blocks = calloc((size_t)block_count + 1, sizeof *blocks);
    for (int64_t i = 0; i < block_count; i++) {
        size_t size = (size_t)read_number();
        blocks[i] = calloc(1, size + 64);
        if (blocks[i] == NULL) fail("there is no memory");
        blocks[i] += 64 - (uintptr_t)blocks[i] % 64;
        if (fread(blocks[i], 1, size, walk) != size) fail("the walk is cut short");
    }
    /* A slot is a number (block -1), or the address of a place in a block. */
    int64_t slot_count = read_number();
    int64_t *slots = calloc((size_t)slot_count, sizeof *slots);
    for (int64_t i = 0; i < slot_count; i++) {
        int64_t block = read_number(), value = read_number();
        slots[i] = block < 0 ? value : (int64_t)(uintptr_t)(blocks[block] + value);
    }
    /* Where the next robot to move, the action and each result are. */
    int64_t shares = read_number(), action = read_number(), result_count = read_number();
    int64_t results[16][3]; /* block, offset, size */
    if (result_count > 16) fail("there are too many results");
    for (int64_t i = 0; i < result_count; i++)
        for (int k = 0; k < 3; k++) results[i][k] = read_number();

    uint64_t hash = UINT64_C(14695981039346656037);
    int64_t steps = read_number();
    const int64_t one_robot[4] = {0, 1, 1, 1};
    for (int64_t step = 0; step < steps; step++) {
        int64_t bits = read_number();
        memcpy(blocks[action], &bits, sizeof bits);
        memcpy(blocks[shares], one_robot, sizeof one_robot);
        control_step((int64_t)(uintptr_t)slots);
        for (int64_t i = 0; i < result_count; i++)
            hash = add_to_hash(hash, blocks[results[i][0]] + results[i][1], results[i][2]);
    }
    printf("%016" PRIx64 "\n", hash);
    return 0;
}
